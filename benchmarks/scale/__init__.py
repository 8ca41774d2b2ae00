"""1 to 100 UAVs with their agents on one router."""

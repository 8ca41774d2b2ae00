"""What a mind tells about itself: decisions, failures, counters of dropped items, snapshots."""

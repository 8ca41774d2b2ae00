"""What mail costs: throughput, latency, backlog, memory."""

"""What it costs that somebody looks on, and what those who look on take."""

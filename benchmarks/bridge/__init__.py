"""What a bridge of three vehicles costs."""

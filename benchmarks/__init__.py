"""What `make bench` measures, each part in a folder of its own, and how its pages are written."""

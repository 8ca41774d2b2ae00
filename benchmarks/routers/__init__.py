"""What crosses the links of a fleet of several routers, and what one router takes on."""

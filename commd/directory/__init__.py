"""The service directory of a board: `registry` what is offered, `service` how it is asked."""

"""Conversions at the edge of a mind: between its terms and records, and from its state to text and views.

`term_conversion` translates terms, percepts and mail to and from the records on the bus; `mind_view` makes the view
that observers ask for; `log_format` makes log lines.
"""

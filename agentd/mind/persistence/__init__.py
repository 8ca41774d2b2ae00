"""State of a mind as rows for a checkpoint: what changed, beliefs, plans, pending events, terms as bytes.

`change_tracking` notes changes, `rows` collects them, `term_codec` encodes; `agentd.persistence` writes the file.
"""

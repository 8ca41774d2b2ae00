"""Run a recorded mind again: `replayed_mind` restores it, `replay` feeds its recorded inputs and compares."""

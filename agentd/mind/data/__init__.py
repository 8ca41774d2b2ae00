"""Types that all parts of the mind share: inputs, effects, events, intentions, frames, timers, internal actions."""

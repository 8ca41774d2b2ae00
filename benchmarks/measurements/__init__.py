"""The parts of the benchmarks, a module each (`benchmarks.parts`), and what several of them share.

`boards` are boards with mail, of `mail` and `crowd`; `fleet` and `vehicles` are UAVs that only talk, of `scale` and
`bridge`; `loop_board` is that of `loop`; `control_groups` are those of `small_boards`.
"""

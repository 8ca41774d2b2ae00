"""The parts of the benchmarks, a module each (`benchmarks.parts`), and what several of them share.

`boards`: boards with mail, for `mail` and `crowd`; `fleet` and `vehicles`: UAVs that only talk, for `scale` and
`bridge`; `loop_board`: the board of `loop`; `control_groups`: limits of `small_boards`.
"""

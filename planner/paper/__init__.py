"""The paper as printed, for `method = "paper"`, and the sensorless plans it is compared with.

`models` (V): the motion model, `sensor` and the collision detector (V.B), `subspaces` of final poses (V.A)
and the `projection` onto them (V.C). `search` (VI): Algorithm 1 with its `open_loop` look-ahead and the
`singleton` ratio. `plan` puts them together (VII). `width`, `sensorless` and `baseline`: Goldberg 1993.
"""

"""rerun recordings of each stage, built from the files that the stage left; open them with `rerun <file>.rrd`.

One module per stage, and no imports here: an edit for one stage must not cause other stages' recordings to be remade.
"""

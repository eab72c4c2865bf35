"""Other laws of the effects, compiled. Each effect of the diagnosis' library has three laws in the
plant: law 0 stands where the effect acts (``arm``, ``pneumatics``, ``hand``, ``touch``, ``key``,
``sensors``), laws 1 and 2 are here; :mod:`~pianobot_ros.emulator.plant.laws.table` lists them all.
"""

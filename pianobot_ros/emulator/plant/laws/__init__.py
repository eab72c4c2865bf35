"""Other laws of the effects, compiled. Each effect of the diagnosis' library has four laws in the
plant: law 0 stands where the effect acts (``arm``, ``pneumatics``, ``hand``, ``touch``, ``key``,
``sensors``), laws 1 to 3 are here; :mod:`~pianobot_ros.emulator.plant.laws.table` lists them all.
"""

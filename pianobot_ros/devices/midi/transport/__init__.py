"""Ways to exchange MIDI messages: ALSA, JACK, or a socket."""

"""What the browser shows: the real cell beside its ghost, and the gap as it opens. Knows no ROS.

A :class:`~pianobot_ros.piano.view.tape.tape.Tape` holds what is known, from a running graph or
from a bag; a :class:`~pianobot_ros.piano.view.page.Page` draws it as of a moment.
"""

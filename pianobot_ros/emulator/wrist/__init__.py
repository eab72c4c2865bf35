"""An emulated Universal Robots controller: RTDE, dashboard and script port, with a UR5 behind them.

Written from the public protocol descriptions and from what the client library ``ur_rtde`` sends. No
real controller was
at hand: ``docs/devices-wrist.md`` says what that leaves open.
"""

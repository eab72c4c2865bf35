"""Finds out whether a UR controller answers at an address, without the client library, which would
wait for ever.
"""

from __future__ import annotations

import socket
import struct

from pianobot_ros.devices.base import DeviceUnavailableError

__all__ = ["probe"]

_PORTS = {30004: "RTDE", 29999: "dashboard", 30003: "script"}
_REQUEST_VERSION = struct.pack(">HBH", 5, 86, 2)
_ADVICE = "is the robot on, on this network, and link.host in wrist.yaml right?"


def probe(host: str, timeout: float = 2.0) -> None:
    """Connect to each port that the client library needs, and ask RTDE for its protocol.

    Raises:
        DeviceUnavailableError: one line that says which port fails and how.
    """
    for port, name in _PORTS.items():
        where = f"the UR controller's {name} port {host}:{port}"
        try:
            with socket.create_connection((host, port), timeout) as connection:
                if port == 30004:
                    connection.sendall(_REQUEST_VERSION)
                    answer = connection.recv(64)
                    if answer != b"\x00\x04\x56\x01":
                        raise DeviceUnavailableError(
                            f"what answers at {host}:{port} does not speak RTDE version 2"
                        )
        except TimeoutError as error:
            raise DeviceUnavailableError(
                f"{where} does not answer within {timeout:g} s: {_ADVICE}"
            ) from error
        except socket.gaierror as error:
            raise DeviceUnavailableError(
                f"'{host}' is not a known host name or address: set link.host"
            ) from error
        except OSError as error:
            raise DeviceUnavailableError(
                f"cannot reach {where} ({error.strerror or error}): {_ADVICE}"
            ) from error

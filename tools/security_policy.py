"""A policy for SROS2 from the running graph: what each of its nodes publishes, hears and serves.

    python tools/security_policy.py [--wait SECONDS] > policy.xml

Start the cell first (``pianobot up``), in the same ROS domain. Every node of ``nodes/graph.py``
gets an enclave of its own, ``/pianobot/<node>``, and nothing that it does not use. docs/security.md
says what to do with the policy.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import xml.etree.ElementTree as Xml
from collections.abc import Iterable, Sequence
from typing import Any

from pianobot_ros.nodes.base.discovery import discovery
from pianobot_ros.nodes.graph import NODES

__all__ = ["policy_of"]


def _names(found: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """Names without those that make up actions."""
    return sorted(name for name, _ in found if "/_action/" not in name)


def policy_of(node: Any, names: Sequence[str]) -> Xml.Element:
    """The policy of the nodes ``names`` (in the root namespace) as ``node`` sees them in the graph.

    Raises KeyError naming a node that is not there.
    """
    from rclpy.action.graph import (
        get_action_client_names_and_types_by_node,
        get_action_server_names_and_types_by_node,
    )

    policy = Xml.Element("policy", version="0.2.0")
    enclaves = Xml.SubElement(policy, "enclaves")
    there = set(node.get_node_names())
    for name in names:
        if name not in there:
            raise KeyError(name)
        enclave = Xml.SubElement(enclaves, "enclave", path=f"/pianobot/{name}")
        profile = Xml.SubElement(Xml.SubElement(enclave, "profiles"), "profile", ns="/", node=name)
        where = (name, "/")
        for kind, what, found in (
            ("topic", "publish", node.get_publisher_names_and_types_by_node(*where)),
            ("topic", "subscribe", node.get_subscriber_names_and_types_by_node(*where)),
            ("service", "reply", node.get_service_names_and_types_by_node(*where)),
            ("service", "request", node.get_client_names_and_types_by_node(*where)),
            ("action", "execute", get_action_server_names_and_types_by_node(node, *where)),
            ("action", "call", get_action_client_names_and_types_by_node(node, *where)),
        ):
            if listed := _names(found):
                group = Xml.SubElement(profile, f"{kind}s", {what: "ALLOW"})
                for one in listed:
                    Xml.SubElement(group, kind).text = one
    return policy


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the policy; 2 if a node is not there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--wait", type=float, default=10.0, help="s for the graph to be seen")
    options = parser.parse_args(arguments)
    os.environ.update(discovery())
    import rclpy
    from rclpy.node import Node

    rclpy.init()
    node = Node("security_policy")
    deadline = time.monotonic() + options.wait
    names = [spec.name for spec in NODES]
    while not set(names) <= set(node.get_node_names()) and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    try:
        policy = policy_of(node, names)
    except KeyError as error:
        print(f"error: no node {error} is running: start `pianobot up` first", file=sys.stderr)
        return 2
    finally:
        node.destroy_node()
        rclpy.shutdown()
    Xml.indent(policy)
    print(Xml.tostring(policy, encoding="unicode"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

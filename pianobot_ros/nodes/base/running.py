"""The main function of every node: start, spin, and on Ctrl-C or SIGTERM shut down in order.

rclpy's own signal handlers invalidate the context first, after which nothing can be published or
stopped through ROS.
So they are not installed: the signal only ends the spinning, then the node closes its hardware, and
the context goes last.
"""

from __future__ import annotations

import gc
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Sequence

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.claims import claim_name
from pianobot_ros.cell.host.marks import LEGACY
from pianobot_ros.cell.host.priority import request_high, request_realtime
from pianobot_ros.cell.host.way_out import way_out
from pianobot_ros.nodes.base.discovery import discovery
from pianobot_ros.nodes.base.node_parameters import check_overrides, keep_changes, keep_wall_time

__all__ = ["run"]

_BAD_INPUT = (
    PianobotError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    rclpy_implementation.RCLError,  # a parameter file that is missing or is not YAML
    rclpy_implementation.RCLInvalidROSArgsError,
    rclpy_implementation.UnknownROSArgsError,
)

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a node in order."""
SHUTDOWN_LIMIT_S = 8.0
"""An orderly shutdown that takes longer than this is stuck in a device; the process then ends
anyway.
"""


def _wake_on_signal(
    wake: Callable[[], None], ending: threading.Event
) -> tuple[socket.socket, socket.socket]:
    """Let a signal end the spinning at once.

    While the main thread waits inside the middleware no Python signal handler runs. The C-level
    handler writes to the wake-up socket instead, and a thread that waits there triggers a guard
    condition.

    Returns:
        Both ends of the wake-up socket, which are to stay open as long as signals may come, also
        those after the first: Python writes each into the socket, and complains where nobody reads.
    """
    receive, send = socket.socketpair()
    send.setblocking(False)
    signal.set_wakeup_fd(send.fileno(), warn_on_full_buffer=False)

    def watch() -> None:
        while not ending.is_set():
            if receive.recv(1)[0] in ENDS:
                _begin_to_end(ending)
        wake()

    _handle(lambda *_: None)
    threading.Thread(target=watch, name="signals", daemon=True).start()
    return receive, send


def _begin_to_end(ending: threading.Event) -> None:
    """Say so, and set the limit to the way out.

    Further signals are ignored: a terminal and a supervisor may both send one.
    """
    if not ending.is_set():
        ending.set()
        limit = threading.Timer(SHUTDOWN_LIMIT_S, _give_up)
        limit.daemon = True
        limit.start()


def _give_up() -> None:
    print(
        f"shutdown did not end within {SHUTDOWN_LIMIT_S:g} s: a device does not answer; leaving",
        file=sys.stderr,
    )
    os._exit(1)


def _interruptible() -> threading.Event:
    """Let the signals that end a node do so while it is being made; the event says that one came.
    Those after it would interrupt the end.

    A shell hands its background jobs an ignored SIGINT, so the handler is set anew.
    """
    came = threading.Event()

    def interrupt(*_: object) -> None:
        if not came.is_set():
            came.set()
            raise KeyboardInterrupt

    _handle(interrupt)
    return came


def _made(came: threading.Event) -> None:
    """From here on a signal no longer interrupts: the node is there and is to be ended in order."""
    _handle(lambda *_: _begin_to_end(came))


def _handle(handler: Callable[..., None]) -> None:
    for number in ENDS:  # a hang-up that nohup has silenced stays so
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _complain(error: BaseException) -> None:
    """One line, without the source position inside rcl that its errors end with."""
    print(f"error: {' '.join(str(error).split()).split(', at /')[0]}", file=sys.stderr)


def run(
    factory: Callable[[], Node],
    arguments: Sequence[str] | None = None,
    *,
    low_priority: bool = False,
    realtime: int = 0,
    alone: bool = True,
) -> int:
    """Create a node, spin it until SIGINT or SIGTERM, and shut down in order.

    Nodes ask to run before other programs, with every thread and process that they start, unless
    they have ``low_priority``. Those whose loops have a deadline give their real-time priority,
    ``realtime``; they get it once they are made, all their threads: one of the middleware that
    waits for the processor would hold the others up.

    A node that is ``alone`` refuses to run beside another of its name in its domain (bad input):
    both would command or measure the same things.

    A node with a method ``shut_down`` gets it called while ROS still works: there it brings its
    hardware to rest.

    What the node was told since its start (a parameter, what the twin adopted) outlasts a process
    that dies: who is started in its place goes on with it. It does not outlast an orderly end.

    Returns:
        0 after an orderly end, 1 after an unexpected error (with traceback), 2 after bad input (one
        line on stderr).
    """
    if not low_priority:
        request_high()
    ending = _interruptible()
    try:
        os.environ.update(discovery())
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        domain = rclpy.get_default_context().get_domain_id()
        LEGACY.inherit([str(domain), *sys.orig_argv])
        node = factory()
        _made(ending)
    except (Exception, KeyboardInterrupt) as error:
        _ignore_signals()
        rclpy.try_shutdown()
        # A compiler in C may turn the interrupt into an error of its own.
        if ending.is_set():
            return 0
        if not isinstance(error, _BAD_INPUT):
            raise
        _complain(error)
        return 2
    gc.collect()
    gc.freeze()  # what is there now stays; going through it again and again would cost milliseconds
    if realtime:
        request_realtime(priority=realtime)
    return _spin(node, alone, ending)


def _spin(node: Node, alone: bool, ending: threading.Event) -> int:
    """Spin the node until a signal comes, or has come, and end it. Returns the exit code."""
    code = 0
    executor = SingleThreadedExecutor()
    claim = None
    try:
        if alone:
            claim = claim_name(node.get_fully_qualified_name(), node.context.get_domain_id())
        check_overrides(node)
        keep_wall_time(node)
        keep_changes(node)
        LEGACY.own()
        executor.add_node(node)
        # A group of its own: the default one is closed while a coroutine of the node waits.
        guard = node.create_guard_condition(lambda: None, callback_group=ReentrantCallbackGroup())
        _sockets = _wake_on_signal(guard.trigger, ending)
        while not ending.is_set():
            executor.spin_once()
    except _BAD_INPUT as error:
        _complain(error)
        code = 2
    except Exception:
        traceback.print_exc()
        code = 1
    finally:
        try:
            shut_down = getattr(node, "shut_down", None)
            if shut_down is not None:
                shut_down()
        except Exception:
            traceback.print_exc()
            code = code or 1
        if code != 1:  # it did not die
            LEGACY.close()
        with way_out(code):
            executor.shutdown(timeout_sec=0.5)
            node.destroy_node()
            rclpy.try_shutdown()
        if claim is not None:
            claim.close()
        _ignore_signals()
    return code


def _ignore_signals() -> None:
    """While Python ends it puts back the default, and a second Ctrl-C (a terminal and a launcher
    may both send one) would make an orderly end look like a crash.
    """
    for number in ENDS:
        signal.signal(number, signal.SIG_IGN)

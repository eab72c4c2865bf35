"""Files that mean harm: recordings, configuration, phrases, MIDI files, logs of other robots."""

from __future__ import annotations

import io
import random
import re
import shutil
import tempfile
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mido
import numpy as np

from fuzzing.target import OutOfLimitsError, Target, changed, number
from pianobot_ros.axis.reading import read_recordings
from pianobot_ros.bags.info import bag_info
from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import schema_of, typestore
from pianobot_ros.bags.raw_messages import RawMessage, read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.repair import repair_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.numbers.config import config_dir
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.cell.score import Score, load_score, plan_score
from pianobot_ros.devices.fsr import FsrConfig
from pianobot_ros.devices.midi import MidiConfig
from pianobot_ros.devices.vacuum import RegulatorConfig
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.gap import GapError
from pianobot_ros.piano.twin.reduced.find_strikes import find_strikes
from pianobot_ros.piano.twin.reduced.splicing import open_session

CSV_DELIMITERS = (",", ",", ",", ";", "\t")


class FileTarget(Target):
    """A door that takes a file."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="pianobot-fuzz-"))

    def close(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)


def small_recording() -> Recording:
    """One strike, in few samples."""
    time = np.arange(0.0, 0.99, 0.025)
    wave = np.column_stack([0.1 * np.sin(k + 7 * time) for k in range(3)])
    signals = {
        "command/wrist.position": TimeSeries(time, wave, "m"),
        "command/vacuum.pressure": TimeSeries(time[:3], -1e4 * np.ones((3, 3)), "Pa"),
        "real/wrist/state.position": TimeSeries(time, wave, "m"),
        "real/vacuum/state.measured": TimeSeries(time, -1e4 * np.ones((40, 3)), "Pa"),
        "real/fsr.force": TimeSeries(time, time, "N"),
        "real/key_angle.64": TimeSeries(time, 0.01 * time, "rad"),
    }
    strike = Strike(0, "p", "c", "middle", 64, 0.1, 0.9, 0.2, 0.012, 0.3, -5e4, 0.8)
    notes = {"real": [NoteEvent(0.3, True, 64, 71), NoteEvent(0.6, False, 64, 44)]}
    return Recording(signals, notes, [strike], fsr_note=64, epoch=1.7e9)


class Mcap(FileTarget):
    """Recordings: bytes of the file changed, or its messages, with the right checksums."""

    name = "mcap"
    cost = 40

    def __init__(self) -> None:
        super().__init__()
        bag = write_bag(small_recording(), self.folder / "good")
        (self._file,) = bag.glob("*.mcap")
        self._bytes, self._raw = self._file.read_bytes(), list(read_raw(bag))

    def make(self, rng: random.Random) -> bytes:
        self.inside = 1
        if rng.random() < 0.4:
            return changed(self._bytes, rng)
        target = self.folder / "made"
        shutil.rmtree(target, ignore_errors=True)
        writer, share = LiveWriter(target), rng.choice((0.02, 0.3, 1.0))
        hurt = [rng.random() < share for _ in self._raw]
        self.inside = max(1, sum(hurt))
        for raw, hostile in zip(self._raw, hurt, strict=True):
            new = self._hurt(raw, rng) if hostile else raw
            if not writer.knows(new.topic):
                text = schema_of(new.type)
                if rng.random() < 0.05:
                    text = text._replace(text=changed(text.text.encode(), rng).decode("latin-1"))
                writer.add_topic(new.topic, new.type, [], text)
            writer.write(new.topic, new.log_time, new.data, new.sent)
        writer.close()
        return writer.file.read_bytes()

    def _hurt(self, raw: RawMessage, rng: random.Random) -> RawMessage:
        match rng.randrange(5):
            case 0:
                return raw._replace(data=changed(raw.data, rng))
            case 1:
                return raw._replace(log_time=rng.choice((0, 2**63, 2**64 - 1, raw.log_time // 2)))
            case 2:
                return raw._replace(sent=rng.choice((0, 2**63, raw.sent + 10**9)))
            case 3:
                return raw._replace(data=rng.choice(self._raw).data)
            case _:
                message = typestore().deserialize_cdr(raw.data, raw.type)
                _poison(message, rng)
                return raw._replace(data=bytes(typestore().serialize_cdr(message, raw.type)))

    def feed(self, data: bytes) -> bool:
        bag = self.folder / "bag"
        for old in self.folder.glob("bag*"):
            shutil.rmtree(old)
        bag.mkdir()
        (bag / "bag_0.mcap").write_bytes(data)
        accepted = 0
        for look in (bag_info, self._read, repair_bag, bag_info, self._read):
            try:
                look(bag)
                accepted += 1
            except (PianobotError, GapError):
                continue
        return accepted > 0

    def _read(self, bag: Path) -> None:
        recording = read_bag(bag)
        for name, signal in recording.signals.items():
            rising = bool(np.all(np.diff(signal.time) > 0))
            known = np.isfinite(signal.value) | (signal.unit in ("Pa", "A"))
            if not rising or not known.all() or not -1e-6 <= signal.time[0] < 1e5:
                raise OutOfLimitsError(f"{name}: {signal}")
        find_strikes(open_session(recording))


def _poison(message: Any, rng: random.Random) -> None:
    """Put a number that cannot be meant into a message of rosbags."""
    numbers = [n for n, v in vars(message).items() if isinstance(v, (float, np.floating))]
    inner = [v for v in vars(message).values() if hasattr(v, "__dataclass_fields__")]
    arrays = [v for v in vars(message).values() if isinstance(v, np.ndarray) and v.size]
    if inner and (not numbers or rng.random() < 0.5):
        _poison(rng.choice(inner), rng)
    elif numbers:
        setattr(message, rng.choice(numbers), number(rng))
    elif arrays:
        chosen = rng.choice(arrays)
        if chosen.dtype.kind == "f":
            chosen[rng.randrange(chosen.size)] = number(rng)
    elif hasattr(message, "sec"):
        message.sec = rng.choice((0, -1, 2**31 - 1, -(2**31), 1))


_TEXT = """true false null .inf .nan -1 0 1e-320 1e308 4294967295 -0.0 'x' [] {} [1,2] {a:1} &a *a
2020-01-01 0x10 1_000 !!python/object:os.system ~ 64 middle thumb 20 0.5"""
_WORDS = tuple(_TEXT.split())
_VALUE = re.compile(rb"(?<=[:,\[{] )[^\s,\]}#]+")


class Yaml(FileTarget):
    """Configuration files and phrases."""

    name = "yaml"
    cost = 10

    def __init__(self) -> None:
        super().__init__()
        self._loaders: dict[str, Callable[[Path], Any]] = {
            "wrist": UrConfig.load,
            "fsr": FsrConfig.load,
            "vacuum": RegulatorConfig.load,
            "midi": MidiConfig.load,
        }
        phrases = sorted((config_dir() / "phrases").glob("*.yaml"))
        files = [*(config_dir() / f"{name}.yaml" for name in self._loaders), *phrases]
        self._files = [(file.stem, file.read_bytes()) for file in files]

    def make(self, rng: random.Random) -> bytes:
        name, data = rng.choice(self._files)
        for _ in range(rng.randint(1, 2)):
            places = list(_VALUE.finditer(data))
            if rng.random() < 0.8 and places:
                place = rng.choice(places)
                word = rng.choice(_WORDS) if rng.random() < 0.7 else repr(number(rng))
                data = data[: place.start()] + word.encode() + data[place.end() :]
            else:
                data = changed(data, rng, 2)
        return name.encode() + b"\n" + data

    def feed(self, data: bytes) -> bool:
        name, _, text = data.partition(b"\n")
        file = self.folder / "file.yaml"
        file.write_bytes(text)
        try:
            loader = self._loaders.get(name.decode())
            if loader is not None:
                loader(file)
            else:
                check_plan(load_score(file))
        except PianobotError:
            return False
        return True


def check_plan(score: Score) -> None:
    """Raise OutOfLimitsError unless the plan of a score stays in the workspace."""
    plan, limits = plan_score(score), wrist_limits()
    inside = np.all((plan.position >= limits.low) & (plan.position <= limits.high))
    lowest = float(plan.pressure.min(initial=0.0))
    if not inside or not lowest >= -101_325 or not plan.duration < 7200:
        raise OutOfLimitsError(
            f"a plan of {plan.duration} s, down to {lowest} Pa, inside: {inside}"
        )


class MidiFiles(FileTarget):
    """Standard MIDI files."""

    name = "midi-files"
    cost = 10

    def __init__(self) -> None:
        super().__init__()
        file = mido.MidiFile()
        track = file.add_track()
        track.append(mido.MetaMessage("set_tempo", tempo=500_000))
        for note in (60, 64, 67):
            track.append(mido.Message("note_on", note=note, velocity=64, time=480))
            track.append(mido.Message("note_off", note=note, time=240))
        stream = io.BytesIO()
        file.save(file=stream)
        self._bytes = stream.getvalue()

    def make(self, rng: random.Random) -> bytes:
        return changed(self._bytes, rng, 4)

    def feed(self, data: bytes) -> bool:
        path = self.folder / "file.mid"
        path.write_bytes(data)
        try:
            check_plan(load_score(path))
        except PianobotError:
            return False
        return True


class Logs(FileTarget):
    """Logs of other robots' joints."""

    cost = 20
    ending = ""

    def __init__(self) -> None:
        super().__init__()
        time = np.arange(60) * 0.02
        heads = ("time", "command", "position", "velocity", "effort")
        rows = [(t, np.sin(t), np.sin(t - 0.1), np.cos(t), 0.1) for t in time]
        self._rows = [dict(zip(heads, (f"{x:.5f}" for x in row), strict=True)) for row in rows]

    def make(self, rng: random.Random) -> bytes:
        rows = [dict(row) for row in self._rows]
        self.inside = rng.choice((1, 2, 4, 30))
        for _ in range(self.inside):
            row = rng.choice(rows)
            row[rng.choice(list(row))] = rng.choice(
                ("", "x", "1e999", "-", '"', repr(number(rng)), "1" * 400)
            )
        data = self.written(rows, rng).encode()
        return changed(data, rng, 2) if rng.random() < 0.3 else data

    @abstractmethod
    def written(self, rows: Sequence[Mapping[str, str]], rng: random.Random) -> str:
        """The text of a log of these cells, each as it is to stand there."""

    def feed(self, data: bytes) -> bool:
        path = self.folder / f"log.{self.ending}"
        path.write_bytes(data)
        try:
            for recording in read_recordings([path]):
                for log in recording.joints.values():
                    if not np.all(np.diff(log.t) > 0) or np.isinf(log.position).any():
                        raise OutOfLimitsError(f"log {log}")
        except (PianobotError, GapError):
            return False
        return True


class Csv(Logs):
    """As a table; some rows with another delimiter."""

    name = ending = "csv"

    def written(self, rows: Sequence[Mapping[str, str]], rng: random.Random) -> str:
        lines = [",".join(rows[0])]
        lines += [rng.choice(CSV_DELIMITERS).join(row.values()) for row in rows]
        return "\n".join(lines)


class Json(Logs):
    """As lines of JSON, a list of records, or one inside the other."""

    name = ending = "json"

    def written(self, rows: Sequence[Mapping[str, str]], rng: random.Random) -> str:
        lines = ["{" + ", ".join(f'"{k}": {v}' for k, v in row.items()) + "}" for row in rows]
        if rng.random() < 0.05:
            lines[rng.randrange(len(lines))] = "[" * rng.choice((20, 2000, 100_000))
        whole = "[" + ",".join(lines) + "]"
        return rng.choice(("\n".join(lines), whole, f'{{"log": {{"entries": {whole}}}}}'))


def file_targets() -> list[type[Target]]:
    """All of them."""
    return [Mcap, Yaml, MidiFiles, Csv, Json]

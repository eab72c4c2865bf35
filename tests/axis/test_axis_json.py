"""JSON in the forms that programs write tables in."""

from __future__ import annotations

import json

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check
from mcap.writer import Writer

from pianobot_ros.axis.reading import read_log, read_recordings
from pianobot_ros.axis.reading.formats.files import tables_of
from pianobot_ros.gap import GapError


def test_json_of_pandas_is_read_in_each_of_its_forms(tmp_path):
    """`DataFrame.to_json(orient=…)`; an object for each row had been a table for each."""
    names = ["time", "command", "position", "torque"]
    table = np.stack([T, U, Q, TAU], axis=1).tolist()
    records = [dict(zip(names, row, strict=True)) for row in table]
    keyed = [{k: v for k, v in r.items() if k != "time"} for r in records]
    forms = {
        "records": records,
        "index": {str(k): r for k, r in enumerate(records)},
        "stamps": {f"{t:.2f}": r for t, r in zip(T, keyed, strict=True)},
        "columns": {n: {str(k): r[n] for k, r in enumerate(records)} for n in names},
        "split": {"columns": names, "index": list(range(len(table))), "data": table},
        "rows": [names, *table],
    }
    for form, held in forms.items():
        path = tmp_path / form / "log.json"
        path.parent.mkdir()
        path.write_text(json.dumps(held))
        (run,) = read_recordings([path])
        (log,) = run.joints.values()
        check(log, effort=True)


def test_an_object_for_each_of_many_rows_is_one_table(tmp_path):
    q = [float(x) for x in Q]
    held = {str(k): {"t": 0.01 * k, "q": [x, -x], "tau": [x, x]} for k, x in enumerate(q * 4)}
    (tmp_path / "log.json").write_text(json.dumps(held))
    assert len(tables_of(tmp_path / "log.json")) == 1
    (run,) = read_recordings([tmp_path / "log.json"])
    assert len(run.joints) == 2


def test_rows_of_json_without_names_are_told_by_their_numbers(tmp_path):
    rows = np.stack([T, U, Q, V, TAU], axis=1).tolist()
    (tmp_path / "log.json").write_text(json.dumps(rows))
    (run,) = read_recordings([tmp_path / "log.json"])
    (log,) = run.joints.values()
    check(log, velocity=True, effort=True)


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_messages_in_json_are_read_from_mcap(tmp_path, encoding):
    """What else they may be written as is said."""
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("State", f"{encoding}schema", b"{}")
        for topic, key, y in (("/state", "position", Q), ("/wanted", "command", U)):
            channel = writer.register_channel(topic, encoding, schema)
            for t, x in zip(T, y, strict=True):
                data = json.dumps({"joint": {key: x}, "mode": "on"}).encode()
                at = round(1e9 * (1.7e9 + t))
                writer.add_message(channel, log_time=at, data=data, publish_time=at)
        writer.finish()
    if encoding == "json":
        check(read_log(tmp_path / "a.mcap"))
        return
    with pytest.raises(GapError, match="written as protobuf"):
        read_log(tmp_path / "a.mcap")

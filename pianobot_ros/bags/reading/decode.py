"""Messages of a bag from their bytes, by the definitions that the bag itself brings."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pianobot_ros.bags.message_types import schema_of, typestore
from pianobot_ros.bags.raw_messages import RawMessage
from pianobot_ros.bags.reading.cdr_layout import CdrLayout

__all__ = ["BagDecoder"]

_LONGEST = 200_000  # characters of a definition


class BagDecoder:
    """Deserializes raw messages. A bag of another version keeps its own definitions."""

    def __init__(self) -> None:
        self._ours = typestore()
        self._stores: dict[tuple[str, str], Typestore] = {}

    def decode(self, raw: RawMessage) -> Any:
        """The message. Raises ValueError if it is not one of its type."""
        try:
            return self._store_of(raw).deserialize_cdr(raw.data, raw.type)
        except Exception as error:  # bytes that are no message: whatever the library makes of them
            raise ValueError(f"not a {raw.type}: {type(error).__name__}") from error

    def layout(self, raw: RawMessage) -> CdrLayout:
        """How the message is laid out. Raises ValueError if it is not one of its type."""
        self.decode(raw)
        return CdrLayout(self._store_of(raw), raw.type, raw.data)

    def _store_of(self, raw: RawMessage) -> Typestore:
        key = raw.type, raw.schema.text
        if key not in self._stores:
            self._stores[key] = self._store(raw)
        return self._stores[key]

    def _store(self, raw: RawMessage) -> Typestore:
        text = raw.schema.text
        known = raw.type in self._ours.fielddefs
        same = known and text == schema_of(raw.type).text
        if same or not text or raw.schema.encoding != "ros2msg" or len(text) > _LONGEST:
            return self._ours
        try:
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(text, raw.type))
        except Exception:  # a damaged definition
            return self._ours
        if known and store.hash_rihs01(raw.type) == self._ours.hash_rihs01(raw.type):
            return self._ours
        return store

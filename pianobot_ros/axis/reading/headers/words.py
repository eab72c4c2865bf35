"""The words of a header, however it is written."""

from __future__ import annotations

import re
from unicodedata import combining, normalize

from pianobot_ros.axis.reading.headers.unit_words import PER_MILLE, SECONDS, UNIT_OF
from pianobot_ros.axis.reading.headers.vocabulary import (
    ACTUAL,
    COMMAND,
    FILLERS,
    LETTERS,
    OTHER,
    WORDS,
    words_of,
)

_PARTS = words_of("nano micro milli")
_CURRENT = re.compile(r"I(?!d)[a-z]_?(\d*)_?([A-Za-z]*)")
"""Currents as drives' papers call them: `Im`, `Iz1`, `Iz1_ref`."""
_MOMENT = re.compile(
    r"(?<![A-Za-z])M(?=_(?i:mot|ist|soll|an|act|ref|des|cmd|meas|\d+)(?![A-Za-z]))"
)
"""Torques as Europeans' formulas call them: `M_mot`, `M_ist`."""
_STAR = re.compile(r"(?<=[A-Za-z])\*(?=$|[\s_(\[,;])")
"""What is wanted, as papers on drives write it: `theta*`."""
_TYPED = re.compile(r"(?<![A-Za-z])(?:lr|[fnibdw])(?=([A-Z][a-z]+)[A-Z])")
"""Letters of a type before what programs of PLCs call their variables: `fIstPosition`."""
_TREE = re.compile(r"^model root/", re.IGNORECASE)
"""The root of a Simulink model, as dSPACE's programs call what they record."""
_SENT = {
    "AIPos": "actual position",
    "ASPos": "set position",
    "EIPos": "actual position ext",
    "ESPos": "set position ext",
    "MACur": "motor current",
    "MECur": "motor current ext",
    "feedBack": "feedback",
    "qfrc_actuator": "effort actuator",
    "RIst": "cartesian",
    "RSol": "cartesian",
}
"""What KUKA's sensor interface calls positions of its axes, currents and poses; ABB's and MuJoCo's
words.
"""
_EASTERN = {
    "time": "时间 時間 时刻 時刻 时间戳",
    "position": "位置 角度 转角 位移 変位",
    "velocity": "角速度 速度 转速 回転速度 回転数",
    "acceleration": "角加速度 加速度",
    "torque": "转矩 扭矩 力矩 トルク",
    "current": "电流 電流",
    "error": "误差 誤差 偏差",
    "target": "目标 目標 期望 指令 给定 设定 設定",
    "actual": "实际 実際 现在 現在 当前 反馈 测量 測定 実測",
    "joint": "关节 関節 电机 モータ モーター 轴 軸",
}
"""Words of Chinese and Japanese, which are written without spaces, by what they are here."""
_FROM_EASTERN = {word: here for here, words in _EASTERN.items() for word in words.split()}
_EAST = re.compile("|".join(sorted(_FROM_EASTERN, key=len, reverse=True)))
SERCOS = re.compile(
    r"(?<![0-9a-z])[sp]-[0-9]-([0-9]{4})(?:\.[0-9]+){0,2}(?![0-9a-z])", re.IGNORECASE
)
_COMPOUND = re.compile(r"\w{3,}?(strom|moment|drehzahl|geschwindigkeit|winkel|kraft)")
"""German compounds are what their last word says (`ausgangsstrom`)."""
_KNOWN = frozenset().union(*WORDS.values(), COMMAND, ACTUAL, OTHER, FILLERS) - {"the", "temp"}
LONGEST = 300
"""Characters of a header that are read: a longer one is no name but data."""


def tokens(header: str) -> list[str]:
    """Lower-case words of a header, digits apart: `actualPos_Joint1` is actual, pos, joint, 1."""
    header = header[:LONGEST]
    current = _CURRENT.fullmatch(header)
    if current and current[2].lower() in COMMAND | ACTUAL | {""}:
        header = f"iq {current[1]} {current[2]}"
    header = _EAST.sub(lambda m: f" {_FROM_EASTERN[m[0]]} ", _TREE.sub("", header))
    header = re.sub("|".join(_SENT), lambda m: _SENT[m[0]], header)
    header = _MOMENT.sub("moment", header)
    header = _STAR.sub(" star", header)
    header = _TYPED.sub(lambda m: "" if m[1].lower() in COMMAND | ACTUAL else m[0], header)
    split = re.sub(r"(?<![A-Za-z])(mA|kN|[mcku]Nm|mN)(?![A-Za-z])", lambda m: m[0].lower(), header)
    split = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", split)
    split = re.sub(r"([A-Z]{2,})([A-Z][a-z])", r"\1 \2", split)
    plain = "".join(
        c for c in normalize("NFKD", split.lower()) if not combining(c)
    )  # é is e, as in µ and ° nothing changes
    plain = SERCOS.sub(" ", PER_MILLE.sub("permille", plain))
    plain = re.sub(
        r"\b0x[0-9a-f]+|(?<![0-9a-z])([0-9][0-9a-f]{3}h|[rp][0-9]{2,5}|[tr]pdo[0-9]+)(?![0-9a-z])",
        " ",
        plain,
    )  # an index of the object dictionary, a drive's parameter (`r0078`), a process data object
    words = re.split(r"[^a-zµμ°%‰0-9]+|(?<=[a-z])(?=[0-9])", plain)
    return _merged([part for w in words if w for part in _parts(w)])


def _merged(words: list[str]) -> list[str]:
    """Words in which a current's `i` and the axis `q` of a motor's field are one (`I_q`): behind an
    i stands no joint's position; and so are the parts of a unit of time (`nano sec`).
    """
    out: list[str] = []
    for word in words:
        before = out[-1] if out else ""
        if (before, word) == ("i", "q") or (before in _PARTS and before + word in WORDS["time"]):
            out[-1] += word
        else:
            out.append(word)
    return out


def _parts(word: str) -> tuple[str, ...]:
    """Known words that were written as one (`sollposition`, `measuredtorque`, `jointacttorque`,
    `pcmd`, `tsec`), or the word.
    """
    behind = re.fullmatch(r"(\d+)([a-z]+)", word)  # `q1d`, `theta2ref`
    if behind and behind[2] in _KNOWN | {"d", "r"}:
        return behind[1], behind[2]
    if word not in _KNOWN:
        first, rest = word[:1], word[1:]
        if first in LETTERS and len(rest) >= 3 and rest in COMMAND | ACTUAL | WORDS["error"]:
            return LETTERS[first], rest
        if first == "t" and len(rest) >= 2 and UNIT_OF.get(rest) in SECONDS:
            return "time", rest
        if joined := _joined(word):
            return joined
        compound = _COMPOUND.fullmatch(word)
        word = compound[1] if compound else word
    return (word,)


def _joined(word: str) -> tuple[str, ...]:
    """The known words that a word consists of, () if it does not: two of them, rather than more."""
    cuts = range(3, len(word) - 2)
    for k in cuts:
        if word[:k] in _KNOWN and word[k:] in _KNOWN:
            return word[:k], word[k:]
        if word[k - 1] == "s" and word[: k - 1] in _KNOWN and word[k:] in _KNOWN:
            return word[: k - 1], word[k:]  # as German joins words
    found = ((word[:k], *_joined(word[k:])) for k in cuts if word[:k] in _KNOWN)
    return next((words for words in found if len(words) > 1), ())


def eastern(text: str) -> bool:
    """Whether a text holds a word of Chinese or Japanese that is known here."""
    return _EAST.search(text) is not None

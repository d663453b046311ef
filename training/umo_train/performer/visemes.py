"""Mouth shapes of the phones: the targets of each, and their dominance over neighbours."""

import numpy as np

from umo_train.speech.utterance import PHONES, SILENCE

CHANNELS = (
    "jawOpen jawForward mouthFunnel mouthPucker mouthStretch mouthSmile mouthLowerDown mouthUpperUp "
    "mouthShrugLower mouthShrugUpper tongueOut"
).split()
CHANNEL = {name: index for index, name in enumerate(CHANNELS)}
# Channels that share a dominance: the jaw, the lips' rounding, and their shape.
JAW, ROUND, SHAPE = (0, 1), (2, 3), (4, 5, 6, 7, 8, 9, 10)

_SHORT = dict(J="jawOpen", F="mouthFunnel", P="mouthPucker", S="mouthStretch", M="mouthSmile", L="mouthLowerDown")
_SHORT |= dict(U="mouthUpperUp", K="mouthShrugLower", H="mouthShrugUpper", T="tongueOut", W="jawForward")
# Per phone: targets in percent, then the dominance of jaw, rounding and shape in percent.
_TABLE = """
aa J62 L30 U12            | 100 50 80
ae J56 S16 M12 L36 U20    | 100 60 90
ah J44 L26 U10            | 90 50 70
ao J52 F38 P14 L16        | 100 100 80
ax J29 L16 U6             | 60 25 40
eh J44 S12 M6 L30 U15     | 100 55 80
er J32 F30 P16 L18 U8 H8  | 90 90 70
ih J32 S16 M10 L26 U12    | 90 55 80
iy J24 S26 M26 L32 U18    | 100 70 100
uh J31 F32 P32 L14        | 90 100 80
uw J21 F34 P64 L6         | 100 120 100
p J10 K10 H6              | 90 15 90
b J11 K10 H6              | 90 15 90
m J10 K8 H6               | 80 15 90
f J9 U22 K6              | 100 20 110
v J10 U20 K6              | 100 20 110
th J13 T34 L20 U10        | 80 15 80
dh J14 T24 L18 U8         | 70 15 60
t J11 L24 U9 S6           | 85 12 50
d J12 L24 U9 S6           | 85 12 50
n J15 L20 U8              | 60 12 45
l J24 L20 U8 T6           | 60 15 50
s J5 S24 M10 L34 U16 W6   | 110 15 90
z J6 S22 M9 L32 U15 W6    | 105 15 85
sh J7 F52 P20 L24 U18 W10 | 110 90 100
zh J8 F48 P18 L22 U16 W10| 105 85 95
ch J7 F48 P18 L24 U16 W8  | 110 80 95
jh J8 F44 P16 L22 U15 W8 | 105 75 90
r J22 F28 P22 L16 U8      | 60 70 60
w J14 F30 P70             | 90 120 100
y J19 S20 M16 L24 U12     | 70 40 70
k J17 L16 U6              | 45 10 30
g J17 L16 U6              | 45 10 30
ng J21 L14 U6             | 35 10 30
hh J20 L12 U5             | 30 8 15
pau J2                    | 60 30 50
"""
# A diphthong goes from one vowel to another; the share of its time that the first has.
_GLIDES = {"aw": ("aa", "uw", 0.6), "ay": ("aa", "ih", 0.6), "ey": ("eh", "iy", 0.5), "ow": ("ao", "uw", 0.45)}
_GLIDES |= {"oy": ("ao", "iy", 0.55)}


def _read() -> tuple[dict[str, int], np.ndarray, np.ndarray]:
    rows, targets, strengths = {}, [], []
    for line in _TABLE.strip().splitlines():
        aims, strength = line.split("|")
        name, *aims = aims.split()
        target = np.zeros(len(CHANNELS))
        for aim in aims:
            target[CHANNEL[_SHORT[aim[0]]]] = int(aim[1:]) / 100.0
        jaw, rounding, shape = (int(x) / 100.0 for x in strength.split())
        strength = np.empty(len(CHANNELS))
        strength[list(JAW)], strength[list(ROUND)], strength[list(SHAPE)] = jaw, rounding, shape
        rows[name] = len(targets)
        targets.append(target)
        strengths.append(strength)
    assert rows.keys() | _GLIDES.keys() == PHONES
    return rows, np.array(targets), np.array(strengths)


_ROW, TARGETS, STRENGTHS = _read()
REST = TARGETS[_ROW[SILENCE]]


def aims(name: str) -> tuple[tuple[int, float], ...]:
    """Rows of `TARGETS` that a phone goes through, each with its share of the time."""
    if name in _GLIDES:
        first, second, share = _GLIDES[name]
        return (_ROW[first], share), (_ROW[second], 1.0 - share)
    return ((_ROW[name], 1.0),)

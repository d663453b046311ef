"""One map for all methods: from the 15 visemes of the Oculus set to opening, width and rounding of the lips.

Sources: the phones of each viseme as in Meta's "Viseme Reference" of Oculus Lipsync; height, backness and rounding of
their vowels and place and manner of their consonants as in the chart of the International Phonetic Association (2020).

- Opening, 0 lips together to 1 an open vowel. Vowels by height: close 0.25, near-close 0.35, mid 0.6, open 1.
  Consonants with a tongue closure or constriction 0.2, sibilants and postalveolars, whose teeth are together, 0.15,
  labiodentals 0.1.
- Width, 0 at rest, 1 a spread close front vowel, -1 a close back rounded one. Front vowels and sibilants are spread,
  rounded sounds narrow.
- Rounding, 0 at rest to 1 a close back rounded vowel: rounded vowels, postalveolars and r in English, by their degree.
"""

import numpy as np

VISEMES = ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "ih", "oh", "ou")
INDEX = {name: index for index, name in enumerate(VISEMES)}

# Rows in the order of VISEMES: opening, width, rounding.
SHAPES = np.array(
    [
        (0.00, 0.0, 0.0),  # sil
        (0.00, 0.0, 0.0),  # PP: p b m, bilabial
        (0.10, 0.0, 0.0),  # FF: f v, labiodental
        (0.20, 0.0, 0.0),  # TH: dental
        (0.20, 0.2, 0.0),  # DD: t d, alveolar
        (0.20, 0.1, 0.0),  # kk: k g, velar
        (0.15, -0.4, 0.6),  # CH: postalveolar, protruded in English
        (0.15, 0.4, 0.0),  # SS: s z, alveolar sibilants
        (0.20, 0.1, 0.0),  # nn: n l, alveolar
        (0.20, -0.3, 0.4),  # RR: r, weakly rounded
        (1.00, 0.0, 0.0),  # aa: open
        (0.60, 0.5, 0.0),  # E: mid front
        (0.35, 1.0, 0.0),  # ih: near-close to close front
        (0.60, -0.6, 0.8),  # oh: mid back rounded
        (0.25, -1.0, 1.0),  # ou: close back rounded
    ]
)

# Others' names of the same shapes.
NAMES = {"I": "ih", "O": "oh", "U": "ou"}
# The five vowels of uLipSync and its ports.
VOWELS = {"A": "aa", "I": "ih", "U": "ou", "E": "E", "O": "oh"}
# pyLipSync's names of them.
VRM = {"aa": "aa", "ih": "ih", "ou": "ou", "ee": "E", "oh": "oh"}
# Rhubarb's drawings, by the description of each in its README.
RHUBARB = {"A": "PP", "B": "SS", "C": "E", "D": "aa", "E": "oh", "F": "ou", "G": "FF", "H": "E", "X": "sil"}


def mouth(weights: np.ndarray) -> np.ndarray:
    """Weights of the visemes `[T, 15]`, mixed linearly, to opening, width and rounding `[T, 3]`."""
    return np.asarray(weights, np.float64) @ SHAPES

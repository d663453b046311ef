"""People's recorded speech: read in the forms in which it is published, its phones and accents found.

| module | |
| --- | --- |
| `recordings` | the sound files of a folder, with their readers and texts |
| `align` | phones of a recording: from its text, without one, or from how a synthesiser speaks its text |
| `accents` | which vowels the reader accents, by pitch, loudness and length |
| `make` | the step `people`: items of the corpus |
| `check` | how well all this agrees with voices whose phones and accents are known |
"""

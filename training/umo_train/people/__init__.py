"""People's recorded speech: readers of published formats, and detection of phones and accents.

| module | |
| --- | --- |
| `recordings` | the sound files of a folder, with their readers and texts |
| `align` | phones of a recording: from its text, without a text, or from a synthesiser's speech |
| `accents` | which vowels the reader accents, by pitch, loudness and length |
| `make` | the step `people`: items of the corpus |
| `check` | accuracy on voices whose phones and accents are known |
"""

"""How good a motion is: each measure in a file of its own, and the report that gathers them.

| file | holds |
| --- | --- |
| `item` | speech with the motion that belongs to it, and its file |
| `motion` | places of the joints, jerk, foot slide, use of codes and experts |
| `lips` | mouth against a reference, closures, stillness, the speech's envelope |
| `beat` | beat constancy, and the same against shifted audio |
| `fgd` | Frechet distance in the features of a motion auto-encoder |
| `diversity` | L1 diversity; whether prompts can be told apart |
| `speed` | time to the first frame, frames per second |
| `agreement`, `experts` | codes in int8 against those in f32; which expert comes first |
| `program` | what the program `umo` makes of a recording |
| `measure`, `bars`, `report`, `plots`, `figure`, `sheet`, `table` | all of it over recordings, judged and shown |
"""

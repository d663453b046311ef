"""Quality measures of motion, one file each, and the report of all of them.

| file | holds |
| --- | --- |
| `item` | speech with its motion, and its file format |
| `motion` | joint positions, jerk, foot slide, use of codes and experts |
| `lips` | mouth compared with a reference, closures, stillness, the speech's envelope |
| `beat` | beat constancy, its ratio to that of shifted audio, and Smooth-BC, which jitter does not raise |
| `genea` | beat alignment and diversity by the definitions of GENEA's leaderboard |
| `takes`, `mismatch`, `mismatch_report` | speech with motion from anywhere; a judge that finds a motion's speech |
| `fgd` | Frechet distance in the features of a motion auto-encoder |
| `diversity` | L1 diversity; separability of prompts |
| `conditions`, `languages`, `interval` | speech over noise and in eleven languages; 95 % intervals |
| `speed` | time to the first frame, frames per second |
| `agreement`, `experts` | codes in int8 compared with f32; first choices of experts |
| `program` | motion of the program `umo` for a recording |
| `measure`, `bars`, `report`, `plots`, `figure`, `sheet`, `table` | all measures over recordings, judged and shown |
"""

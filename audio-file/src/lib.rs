//! Recordings of speech from files, as `f32` samples: WAV, also damaged, by `hound`; FLAC, MP3, Ogg
//! Vorbis and AAC by `symphonia`; Opus by `ogg` and `ropus`. [`wav::read`] reads them all.

mod compressed;
pub mod wav;

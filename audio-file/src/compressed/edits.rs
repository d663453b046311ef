//! The edit list of an MPEG-4 file's audio track: which of the decoded audio is the recording.
//! `symphonia` does not apply it, and encoders put 1024 to some 2000 samples before the recording.

/// The part of a track that is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edit {
    /// Where it starts, in units of `1 / scale` seconds.
    start: u64,
    scale: u32,
    /// Its length, in units of `1 / length_scale` seconds.
    length: u64,
    length_scale: u32,
}

impl Edit {
    /// Keeps the part of interleaved `samples` that is played.
    pub(super) fn apply(self, samples: &mut Vec<f32>, sample_rate: u32, channels: usize) {
        let frames = |time: u64, scale: u32| (u128::from(time) * u128::from(sample_rate)).div_ceil(u128::from(scale));
        let count = |frames: u128| usize::try_from(frames).unwrap_or(usize::MAX).saturating_mul(channels);
        let start = count(frames(self.start, self.scale)).min(samples.len());
        samples.drain(..start);
        // A length is rounded to its scale, which may be coarse.
        let length = count(frames(self.length + 1, self.length_scale));
        if self.length > 0 {
            samples.truncate(length);
        }
    }
}

/// The edit of the first audio track, where there is one and no other.
pub(super) fn of_audio(bytes: &[u8]) -> Option<Edit> {
    let moov = child(bytes, b"moov")?;
    let length_scale = scale(child(moov, b"mvhd")?)?;
    boxes(moov).filter(|(kind, _)| kind == b"trak").find_map(|(_, track)| {
        let media = child(track, b"mdia")?;
        (child(media, b"hdlr")?.get(8..12)? == b"soun").then_some(())?;
        let list = child(child(track, b"edts")?, b"elst")?;
        let scale = scale(child(media, b"mdhd")?)?;
        let wide = *list.first()? == 1;
        let mut used = None;
        for entry in list.get(8..)?.chunks_exact(if wide { 20 } else { 12 }) {
            let (length, start) = match wide {
                true => {
                    (u64::from_be_bytes(entry[..8].try_into().ok()?), i64::from_be_bytes(entry[8..16].try_into().ok()?))
                }
                false => (number(entry)?.into(), i64::from(number(entry.get(4..)?)?.cast_signed())),
            };
            // A negative start is a pause before the recording.
            if let Ok(start) = u64::try_from(start)
                && used.replace(Edit { start, scale, length, length_scale }).is_some()
            {
                return None;
            }
        }
        used.filter(|edit| edit.length < u64::MAX)
    })
}

/// Units per second of an `mvhd` or `mdhd` box, not 0.
fn scale(header: &[u8]) -> Option<u32> {
    let at = if *header.first()? == 1 { 20 } else { 12 };
    number(header.get(at..)?).filter(|&scale| scale > 0)
}

fn number(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk().map(|&bytes| u32::from_be_bytes(bytes))
}

/// What is in the first box of a kind.
fn child<'a>(bytes: &'a [u8], wanted: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(bytes).find(|(kind, _)| kind == wanted).map(|(_, body)| body)
}

/// The boxes of a box, or of a file: kind and contents.
fn boxes(mut bytes: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let size = number(bytes)?;
        let kind = *bytes.get(4..)?.first_chunk::<4>()?;
        let (header, size) = match size {
            0 => (8, bytes.len()),
            1 => (16, usize::try_from(u64::from_be_bytes(*bytes.get(8..)?.first_chunk()?)).ok()?),
            size => (8, size as usize),
        };
        let body = bytes.get(header..size)?;
        bytes = &bytes[size..];
        Some((kind, body))
    })
}

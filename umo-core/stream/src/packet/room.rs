//! The sending side: writes a packet of the last chunk.

use umo_core_base::error::StepError;
use umo_core_base::memory::filled;
use umo_core_model::avatar::{Avatar, Due};
use umo_core_model::config::Config;

use super::{PacketHead, PacketLayout, SOUND, arousal_byte, level_byte};
use crate::levels::Levels;

/// Buffers for the contents of a packet.
#[derive(Debug)]
pub(crate) struct PacketRoom {
    sounds: Box<[[u8; SOUND]]>,
    codes: Box<[u16]>,
    mouth: Box<[u8]>,
}

impl PacketRoom {
    /// Creates buffers for any avatar of a model.
    pub(crate) fn new(config: &Config, layout: &PacketLayout) -> Self {
        let count = config.prefix * config.codes_per_keyframe();
        Self {
            sounds: filled([0; SOUND], config.prefix).into(),
            codes: filled(0, count).into(),
            mouth: filled(0, layout.max_mouth_frames() * layout.mouth()).into(),
        }
    }

    /// Writes the packet of the chunk that `stepped` describes into `out`, repeating up to `history` earlier
    /// keyframes. Returns its length, or `None` if nothing was computed. Never allocates.
    #[expect(clippy::too_many_arguments, reason = "an avatar, its results and their destination")]
    pub(crate) fn write(
        &mut self,
        avatar: &Avatar,
        config: &Config,
        layout: &PacketLayout,
        stepped: Due,
        (stream, history): (u8, usize),
        levels: &Levels,
        out: &mut [u8],
    ) -> Result<Option<usize>, StepError> {
        let keyframes = match stepped {
            Due::Chunk | Due::Held => avatar.target,
            Due::Flush => 0,
            Due::Audio | Due::Nothing => return Ok(None),
        };
        // No more than the stream has sent.
        let done = usize::try_from(avatar.chunk).unwrap_or(usize::MAX).saturating_mul(avatar.target) - keyframes;
        let history = history.min(config.prefix - keyframes).min(done);
        let is_last = avatar.total.is_some() && Some(avatar.chunk) >= avatar.chunks(config);
        let sequence = avatar.chunk - if keyframes > 0 { 1 } else { 0 };
        let mouth = avatar.mouth_frames();
        let begins = sequence * (avatar.target * config.keyframe_stride) as u64;
        let most = layout.max_mouth_frames() as u64;
        let mouth = mouth.start.max(mouth.end.saturating_sub(most))..mouth.end;
        let mouth_back = u16::try_from(begins.saturating_sub(mouth.start)).unwrap_or(u16::MAX);
        let head = PacketHead {
            stream,
            sequence: u32::try_from(sequence).unwrap_or(u32::MAX),
            sample: sequence * (avatar.target * config.samples_per_keyframe()) as u64,
            root: avatar.run.place(),
            keyframes,
            history,
            total: avatar.total.filter(|_| is_last).map(|total| u32::try_from(total).unwrap_or(u32::MAX)),
            is_prompted: levels.is_prompted(),
            mouth_frames: usize::try_from(mouth.end - mouth.start).unwrap_or_default(),
            mouth_back: if mouth.is_empty() { 0 } else { mouth_back },
        };
        let heard = &mut self.sounds[..keyframes];
        for (i, sound) in heard.iter_mut().enumerate() {
            let first = (sequence * avatar.target as u64 + i as u64) * config.keyframe_stride as u64;
            *sound = [level_byte(levels.mean(first, config.keyframe_stride)), arousal_byte(levels.arousal(first))];
        }
        let codes = &mut self.codes[..(history + keyframes) * layout.codes()];
        avatar.window.last(codes);
        let said = &mut self.mouth[..head.mouth_frames * layout.mouth()];
        for (frame, said) in mouth.zip(said.chunks_exact_mut(layout.mouth().max(1))) {
            said.copy_from_slice(avatar.mouth(frame));
        }
        layout.encode(&head, heard, codes, said, out).map(Some)
    }
}

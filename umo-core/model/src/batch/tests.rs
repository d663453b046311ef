//! Bounded steps give the same frames as whole ones.

use umo_core_base::team::Team;
use umo_kernels::Isa;

use super::*;
use crate::avatar::AvatarConfig;
use crate::linear::Precision;
use crate::weights::ModelFile;

/// More than one bounded step of a decoder pass takes.
const MEMBERS: usize = 6;

/// Bits of every member's frames.
struct Bits(Vec<Vec<u32>>);

impl FrameSink for Bits {
    fn frame(&mut self, member: usize, frame: FrameRef) {
        let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(frame.face);
        self.0[member].extend(values.map(|value| value.to_bits()));
    }
}

/// Runs two chunks and the flush; returns the steps of the longest chunk, and all frames.
fn frames(model: &Model, bounded: bool) -> (usize, Vec<Vec<u32>>) {
    let (config, team) = (&model.config, Team::alone());
    let cx = Compute { isa: model.isa, team: &team };
    let mut batch = Batch::new(model, MEMBERS);
    if bounded {
        batch.bound(config);
    }
    let avatar = |member: usize| {
        let mut settings = AvatarConfig::new(config);
        settings.sampler.seed = member as u64;
        // Different windows, and one member with smoothing.
        settings.target = 2 + member;
        settings.smoothing = if member == 1 { 1.0 } else { 0.0 };
        Avatar::new(model, &settings).unwrap()
    };
    let mut avatars: Vec<_> = (0..MEMBERS).map(avatar).collect();
    let (mut bits, mut most) = (Bits(vec![Vec::new(); MEMBERS]), 0);
    for chunk in 0..3 {
        for (member, avatar) in avatars.iter_mut().enumerate() {
            if chunk == 2 {
                avatar.finish(avatar.known_frames(config, 2));
                continue;
            }
            let pitch = 0.02 + 0.01 * member as f32;
            let tone = |at: usize| 0.3 * (at as f32 * pitch).sin() * (at as f32 * 0.0007).sin();
            avatar.samples_mut().iter_mut().enumerate().for_each(|(at, sample)| *sample = tone(at + chunk * 8000));
        }
        let due = if chunk < 2 { Due::Chunk } else { Due::Flush };
        batch.begin(std::iter::repeat_n(due, MEMBERS)).unwrap();
        let mut steps = 1;
        while batch.step(model, cx, &mut avatars, &mut bits).unwrap() {
            steps += 1;
        }
        most = most.max(steps);
    }
    (most, bits.0)
}

#[test]
fn short_steps_give_the_frames_of_long_ones() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
    let file = ModelFile::open(path.as_ref()).unwrap();
    let model = Model::load(&file, Precision::Stored, Isa::detect()).unwrap();
    let ((long, want), (short, got)) = (frames(&model, false), frames(&model, true));
    assert!(got.iter().all(|frames| frames.len() > 1000) && got[0] != got[1]);
    assert!(got == want);
    // Every encoder layer is divided by heads and by experts.
    assert!(short > long + 4 * MEMBERS * 8, "{short} steps where {long} are not cut");
}

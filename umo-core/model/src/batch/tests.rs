//! Bounded steps give the same frames as whole ones.

use umo_core_base::team::Team;
use umo_kernels::Isa;

use super::*;
use crate::avatar::AvatarConfig;
use crate::layout::FREE;
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

fn people() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
    let file = ModelFile::open(path.as_ref()).unwrap();
    Model::load(&file, Precision::Stored, Isa::detect()).unwrap()
}

/// Frames, and the codes of each chunk, of three chunks of a tone in which codes are set.
fn take(model: &Model, want: impl Fn(usize, &mut [u16])) -> (Vec<u32>, Vec<Vec<u16>>) {
    let (config, team) = (&model.config, Team::alone());
    let cx = Compute { isa: model.isa, team: &team };
    let mut batch = Batch::new(model, 1);
    batch.keep_record(config);
    let mut avatar = Avatar::new(model, &AvatarConfig::new(config)).unwrap();
    avatar.sampler.sampling.temperature = 1.0;
    let (mut bits, mut chunks) = (Bits(vec![Vec::new()]), Vec::new());
    for chunk in 0..3 {
        let tone = |at: usize| 0.3 * (at as f32 * 0.03).sin() * (at as f32 * 0.0007).sin();
        avatar.samples_mut().iter_mut().enumerate().for_each(|(at, sample)| *sample = tone(at + chunk * 8000));
        let mut codes = vec![FREE; avatar.target * config.codes_per_keyframe()];
        want(chunk, &mut codes);
        avatar.want(&codes).unwrap();
        let due = avatar.due(config, usize::MAX);
        assert_eq!(due, if codes.contains(&FREE) { Due::Chunk } else { Due::Held });
        batch.begin([due].into_iter()).unwrap();
        while batch.step(model, cx, std::slice::from_mut(&mut avatar), &mut bits).unwrap() {}
        chunks.push(batch.chunk().unwrap().keyframes.to_vec());
    }
    (bits.0.remove(0), chunks)
}

#[test]
fn codes_that_are_set_are_not_drawn_and_the_others_answer_to_them() {
    let model = people();
    let (frames, codes) = take(&model, |_, _| ());
    // All of a take's codes: the same frames, without the language model.
    assert!(take(&model, |chunk, want| want.copy_from_slice(&codes[chunk])) == (frames, codes.clone()));
    // The phases of the second chunk alone: chunks before it keep their codes.
    let count = model.config.codes_per_keyframe();
    let parts = model.config.part_list();
    let intent = parts.iter().take_while(|part| part.name != "intent").map(|part| part.levels).sum::<usize>();
    let others = |codes: &[u16]| {
        let others = codes.iter().enumerate().filter(|(at, _)| at % count != intent);
        others.map(|(_, &code)| code).collect::<Vec<_>>()
    };
    for phase in [6, 9] {
        let force = |chunk: usize, want: &mut [u16]| {
            if chunk == 1 {
                want.iter_mut().skip(intent).step_by(count).for_each(|code| *code = phase);
            }
        };
        let (_, edited) = take(&model, force);
        assert!(edited[1].iter().skip(intent).step_by(count).all(|&code| code == phase));
        assert!(edited[0] == codes[0] && others(&edited[1]) != others(&codes[1]));
    }
    let mut avatar = Avatar::new(&model, &AvatarConfig::new(&model.config)).unwrap();
    assert!(avatar.want(&[FREE]).is_err());
    let mut want = vec![FREE; avatar.target * count];
    want[intent] = 13;
    assert!(avatar.want(&want).is_err());
}

#[test]
fn short_steps_give_the_frames_of_long_ones() {
    let model = people();
    let ((long, want), (short, got)) = (frames(&model, false), frames(&model, true));
    assert!(got.iter().all(|frames| frames.len() > 1000) && got[0] != got[1]);
    assert!(got == want);
    // Every encoder layer is divided by heads and by experts.
    assert!(short > long + 4 * MEMBERS * 8, "{short} steps where {long} are not cut");
}

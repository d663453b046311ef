//! The record of chunks: recording changes no frame, the recorded codes give the frames,
//! and the expert counts add up to every token once per layer.

mod model_bytes;

use model_bytes::ModelBytes;
use umo_core::{Animation, AvatarConfig, Compute, Config, Model, ModelFile, Part, PerPart, Precision, Team};
use umo_core_model::lm::layout::window_tokens;
use umo_core_model::lm::tally::kind_names;
use umo_kernels::Isa;
use umo_tests::Noise;

const NAMES: [&str; 6] =
    ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_four", "frames_seven"];
const FRAMES: usize = 100;

/// Result of a run.
#[derive(Default)]
struct Run {
    /// Channels of every part, frame by frame.
    channels: PerPart<Vec<u32>>,
    codes: PerPart<Vec<u16>>,
    /// `[keyframes, codes of a keyframe]`, in layout `frames`.
    keyframes: Vec<u16>,
    /// Number of frames that the chunks made known.
    known: usize,
    /// First frame of each chunk, and its counts.
    chunks: Vec<(usize, Vec<u32>)>,
}

fn run(model: &Model, cx: Compute, config: &AvatarConfig, keep: bool) -> Run {
    let mut noise = Noise::new(7);
    let samples = FRAMES * model.config().audio.sample_rate / model.config().frame_rate;
    let audio: Vec<f32> = (0..samples).map(|i| 0.3 * (i as f32 * 0.07).sin() + noise.float(0.05)).collect();
    let mut animation = Animation::new(model, config).unwrap();
    if keep {
        animation.keep_record(model.config());
    }
    animation.push_audio(&audio).unwrap();
    animation.finish(FRAMES);
    let mut run = Run::default();
    let mut take = |frame: umo_core::FrameRef| {
        for part in Part::ALL {
            run.channels[part].extend(frame.channels[part].iter().map(|v| v.to_bits()));
        }
    };
    while animation.step(model, cx, &mut take).unwrap() {
        assert_eq!(animation.chunk().is_some(), keep);
        let Some(chunk) = animation.chunk() else { continue };
        assert_eq!(chunk.index, run.chunks.len() as u64);
        run.chunks.push((chunk.first_frame, chunk.tally.counts().to_vec()));
        assert_eq!(chunk.first_frame, run.known);
        run.known += chunk.frames;
        run.keyframes.extend_from_slice(chunk.keyframes);
        Part::ALL.into_iter().for_each(|part| run.codes[part].extend_from_slice(chunk.codes[part]));
    }
    run
}

/// Calls `check` with every golden model and a run that recorded.
fn each(check: impl Fn(&str, &Model, Compute, &AvatarConfig, Run)) {
    let team = Team::new(1).unwrap();
    for name in NAMES {
        let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
        let model = Model::load(&file, Precision::Stored, Isa::detect()).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        let target = 2.min(model.config().max_target);
        let config = AvatarConfig { target, lookahead: model.motion().reach(), ..AvatarConfig::new(model.config()) };
        check(name, &model, cx, &config, run(&model, cx, &config, true));
    }
}

#[test]
fn keeping_a_record_changes_no_bit() {
    each(|name, model, cx, config, kept| {
        assert!(run(model, cx, config, false).channels == kept.channels, "{name}");
    });
}

#[test]
fn recorded_codes_are_those_of_the_frames() {
    each(|name, model, cx, _, kept| {
        if model.config().is_frames() {
            assert!(kept.codes.lower.is_empty(), "{name}");
            return;
        }
        assert!(kept.keyframes.is_empty(), "{name}");
        let whole = model.motion().decode(cx, PerPart::from_fn(|part| &*kept.codes[part])).unwrap();
        let sure = FRAMES - model.motion().reach();
        for part in Part::ALL {
            let values = sure * model.motion().channels(part);
            let decoded = whole.channels[part][..values].iter().map(|v| v.to_bits());
            assert!(decoded.eq(kept.channels[part][..values].iter().copied()), "{name}, {}", part.name());
        }
    });
}

/// With a keyframe in every frame nothing is interpolated, so the frames are the decoded recorded
/// codes.
#[test]
fn recorded_keyframes_are_those_of_the_frames() {
    let mut bytes = ModelBytes::open("frames_seven");
    bytes.config["frame_rate"] = bytes.config["audio"]["token_rate"].clone();
    bytes.config["keyframe_stride"] = 1.into();
    bytes.config["lookahead"] = 0.into();
    let file = ModelFile::from_bytes(bytes.bytes()).unwrap();
    let model = Model::load(&file, Precision::F32, Isa::detect()).unwrap();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let config = AvatarConfig { target: 2, lookahead: model.config().prefix, ..AvatarConfig::new(model.config()) };
    let kept = run(&model, cx, &config, true);
    let (list, count) = (model.config().part_list(), model.config().codes_per_keyframe());
    assert_eq!(kept.keyframes.len(), kept.known * count);
    assert!(kept.known >= FRAMES);
    let (mut codes, mut first) = (Vec::new(), 0);
    for part in &list {
        if !part.is_annotation() {
            let rows = kept.keyframes.chunks(count);
            codes.push(rows.flat_map(|row| row[first..first + part.levels].to_vec()).collect::<Vec<_>>());
        }
        first += part.levels;
    }
    let codes: Vec<_> = codes.iter().map(Vec::as_slice).collect();
    let whole = model.motion().decode_list(cx, &codes).unwrap();
    // Near a chunk's end, within the decoders' reach, the newest frame stood for later ones; the first
    // frames are not near one.
    let sure = config.lookahead.saturating_sub(model.motion().reach()) + 1;
    for part in Part::ALL {
        let values = sure * model.motion().channels(part);
        let decoded = whole.channels[part][..values].iter().map(|v| v.to_bits());
        assert!(decoded.eq(kept.channels[part][..values].iter().copied()), "{}", part.name());
    }
}

#[test]
fn chunks_follow_each_other_from_keyframe_to_keyframe() {
    each(|name, model, _, config, kept| {
        let stride = model.config().keyframe_stride;
        for (i, (first, _)) in kept.chunks.iter().enumerate() {
            let wanted = if i == 0 { 0 } else { i * config.target * stride + 1 - stride };
            assert_eq!(*first, wanted, "{name}");
        }
        let known = kept.chunks.len() * config.target * stride + 1 - stride;
        assert_eq!(kept.known, known, "{name}");
        match model.config().is_frames() {
            true => assert_eq!(
                kept.keyframes.len(),
                kept.chunks.len() * config.target * model.config().codes_per_keyframe(),
                "{name}"
            ),
            false => assert_eq!(kept.codes.lower.len(), known, "{name}"),
        }
        assert!(known >= FRAMES);
    });
}

/// Numbers of rows that a layer of the encoder, or of the decoder, computes in a chunk.
fn rows(config: &Config, target: usize, encoder: bool) -> Vec<usize> {
    let p = config.prefix + 2;
    let template = &config.templates["audio_to_motion"];
    let text = template.iter().filter(|item| matches!(item, umo_core_model::config::TemplateItem::Id(_))).count();
    let audio = window_tokens(config, target) + 2;
    match (config.is_frames(), encoder) {
        (true, true) => vec![text, audio, config.prefix, 0],
        (true, false) => vec![0, 0, 0, target],
        (false, true) => vec![text, audio, p, p, p, p],
        // The last code and its marker are never inputs.
        (false, false) => vec![1, 0, target + 2, target + 2, target + 2, target],
    }
}

#[test]
fn experts_take_every_token_in_every_layer() {
    each(|name, model, _, config, kept| {
        let (c, target) = (model.config(), config.target);
        for (_, counts) in &kept.chunks {
            let layers: Vec<&[u32]> = counts.chunks(kind_names(c).len() * c.lm.experts).collect();
            assert_eq!(layers.len(), c.lm.num_layers + c.lm.num_decoder_layers);
            for (layer, counts) in layers.iter().enumerate() {
                let wanted = rows(c, target, layer < c.lm.num_layers);
                for (kind, counts) in counts.chunks(c.lm.experts).enumerate() {
                    let sum: u32 = counts.iter().sum();
                    assert_eq!(
                        sum as usize,
                        wanted[kind] * c.lm.top_k,
                        "{name}, layer {layer}, {}",
                        kind_names(c)[kind]
                    );
                }
            }
        }
    });
}

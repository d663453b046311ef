//! Invariants of the interpolation network and the motion codecs for any weights. The golden tests
//! show that they compute the same as PyTorch.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use proptest::prelude::*;
use umo_core::{Compute, FaceKind, ModelFile, Part, PerPart, Pose, Precision, StepError, Team};
use umo_core_model::interp::Interp;
use umo_core_model::motion::{MotionDecoder, MotionEncoder, MotionStream, Smoothing};
use umo_core_model::weights::Loader;
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::quat_to_axis_angle;
use umo_kernels::Isa;

const MODELS: [&str; 4] = ["hubert_k1_smplx", "mel_k2_arkit", "mel_k1_upcycled", "hubert_k3_i8"];

type Codes = PerPart<Vec<u16>>;

struct Model {
    name: &'static str,
    file: ModelFile,
    interp: Interp,
    decoder: MotionDecoder,
    encoder: Option<MotionEncoder>,
}

impl Model {
    fn load(name: &'static str, precision: Precision) -> Self {
        let file = ModelFile::open(&folder(name).join("model.safetensors")).unwrap();
        let loader = Loader::new(&file, precision, Isa::detect());
        let interp = Interp::load(&loader).unwrap();
        let decoder = MotionDecoder::load(&loader).unwrap();
        let encoder = MotionEncoder::load(&loader).unwrap();
        Self { name, interp, decoder, encoder, file }
    }
}

static ALL: LazyLock<Vec<Model>> = LazyLock::new(|| MODELS.map(|name| Model::load(name, Precision::F32)).into());

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name)
}

fn with_compute<R>(threads: usize, f: impl FnOnce(Compute) -> R) -> R {
    let team = Team::new(threads).unwrap();
    f(Compute { isa: Isa::detect(), team: &team })
}

fn slices(codes: &Codes) -> PerPart<&[u16]> {
    PerPart::from_fn(|part| &*codes[part])
}

/// Inputs of the motion decoders.
fn latents(codes: &Codes) -> [&[u16]; 4] {
    Part::ALL.map(|part| &*codes[part])
}

fn fill(model: &Model, cx: Compute, codes: &Codes) -> Result<(Codes, PerPart<Vec<f32>>), StepError> {
    let mut filled = codes.clone();
    let mut scratch = model.interp.scratch(model.interp.max_frames());
    let Codes { face, hands, upper, lower } = &mut filled;
    model.interp.fill(cx, &mut scratch, PerPart { face, hands, upper, lower })?;
    Ok((filled, PerPart::from_fn(|part| scratch.logits(part).to_vec())))
}

/// Random codes of `frames` frames, from a small local generator.
fn random_codes(frames: usize, seed: u64) -> Codes {
    let mut state = seed;
    PerPart::from_fn(|_| {
        let next = |_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            u16::from((state >> 56) as u8)
        };
        (0..frames).map(next).collect()
    })
}

/// Output of a stream.
#[derive(Default, PartialEq, Debug)]
struct Streamed {
    channels: PerPart<Vec<f32>>,
    poses: Vec<Pose>,
    face: Vec<f32>,
}

/// Pushes `codes` in pieces of `sizes` (repeated in a cycle), then ends after `total` frames.
fn stream(model: &Model, cx: Compute, codes: &Codes, sizes: &[usize], lookahead: usize, total: usize) -> Streamed {
    smoothed_stream(model, cx, codes, sizes, (lookahead, Smoothing::OFF), total)
}

/// The same with a low-pass filter.
fn smoothed_stream(
    model: &Model,
    cx: Compute,
    codes: &Codes,
    sizes: &[usize],
    (lookahead, smoothing): (usize, Smoothing),
    total: usize,
) -> Streamed {
    let decoder = &model.decoder;
    let max_push = *sizes.iter().max().unwrap();
    let mut state = MotionStream::new(decoder, max_push, lookahead, smoothing);
    let mut scratch = decoder.scratch(decoder.stream_rows(max_push, lookahead));
    let mut out = Streamed::default();
    let (mut at, mut size) = (0, sizes.iter().cycle());
    let mut take = |frame: umo_core::FrameRef| {
        assert_eq!(frame.index, out.poses.len(), "every frame once and in order");
        for part in Part::ALL {
            out.channels[part].extend_from_slice(frame.channels[part]);
        }
        out.poses.push(*frame.pose);
        out.face.extend_from_slice(frame.face);
    };
    while at < codes.face.len() {
        let end = (at + size.next().unwrap()).min(codes.face.len());
        let piece = Part::ALL.map(|part| &codes[part][at..end]);
        state.push(cx, decoder, &mut scratch, &piece, lookahead, &mut take).unwrap();
        assert_eq!(state.emitted(), end.saturating_sub(lookahead.max(smoothing.radius())));
        at = end;
    }
    state.finish(cx, decoder, &mut scratch, total, &mut take).unwrap();
    out
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

fn pushes() -> impl Strategy<Value = Vec<usize>> {
    prop_oneof![
        proptest::collection::vec(1_usize..40, 1..6),
        Just(vec![6]),
        Just(vec![1]),
        Just(vec![30]),
        (0_usize..8, 1_usize..20).prop_map(|(a, b)| vec![a, b]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_stream_that_looks_ahead_gives_the_bits_of_a_whole_decode(
        which in 0_usize..4, frames in 1_usize..110, seed in any::<u64>(), sizes in pushes(), more in 0_usize..4,
        trim in 0_usize..3,
    ) {
        let model = &ALL[which];
        let codes = random_codes(frames, seed);
        let lookahead = model.decoder.reach() + more;
        let total = frames - trim.min(frames - 1);
        with_compute(1, |cx| {
            let whole = model.decoder.decode(cx, slices(&codes)).unwrap();
            // No frame that the end later cuts off may be output before: that needs as much
            // lookahead as is trimmed.
            let got = stream(model, cx, &codes, &sizes, lookahead, total);
            assert_eq!(got.poses.len(), total);
            for part in Part::ALL {
                let want = &whole.channels[part][..total * model.decoder.channels(part)];
                assert_eq!(bits(&got.channels[part]), bits(want), "{} {}", model.name, part.name());
            }
            for (pose, want) in got.poses.iter().zip(&whole.rotations) {
                let mut rotations = pose.rotations.map(quat_to_axis_angle);
                (rotations[23], rotations[24]) = ([0.0; 3], [0.0; 3]);
                assert_eq!(bits(rotations.as_flattened()), bits(want.as_flattened()));
            }
        });
    }

    #[test]
    fn a_stream_that_sees_all_of_the_root_gives_the_bits_of_its_path(
        which in 0_usize..4, frames in 1_usize..120, seed in any::<u64>(), sizes in pushes(),
    ) {
        let model = &ALL[which];
        let codes = random_codes(frames, seed);
        with_compute(1, |cx| {
            let whole = model.decoder.decode(cx, slices(&codes)).unwrap();
            let got = stream(model, cx, &codes, &sizes, model.decoder.root_reach(), frames);
            for (pose, want) in got.poses.iter().zip(&whole.translation) {
                assert_eq!(bits(&pose.translation), bits(want));
            }
        });
    }

    #[test]
    fn any_lookahead_gives_every_frame_once_and_sound(
        which in 0_usize..4, frames in 1_usize..100, seed in any::<u64>(), sizes in pushes(), lookahead in 0_usize..14,
    ) {
        let model = &ALL[which];
        let codes = random_codes(frames, seed);
        let got = with_compute(1, |cx| stream(model, cx, &codes, &sizes, lookahead, frames));
        prop_assert_eq!(got.poses.len(), frames);
        prop_assert_eq!(got.face.len(), frames * model.decoder.assembly().face_values());
        prop_assert!(got.face.iter().all(|v| v.is_finite()));
        let arkit = model.file.config().face.kind == FaceKind::Arkit;
        prop_assert!(!arkit || got.face.iter().all(|v| (0.0..=1.0).contains(v)));
        for pose in &got.poses {
            prop_assert!(pose.translation.iter().all(|v| v.is_finite()));
            for q in &pose.rotations {
                let length: f64 = q.iter().map(|&v| f64::from(v).powi(2)).sum();
                prop_assert!((length - 1.0).abs() < 1e-6 && q[3] >= 0.0, "{q:?}");
            }
        }
    }

    #[test]
    fn anchors_survive_and_nothing_else_is_masked(
        which in 0_usize..4, frames in 1_usize..50, seed in any::<u64>(), anchors in any::<u64>(),
    ) {
        let model = &ALL[which];
        let mask = u16::try_from(model.interp.mask()).unwrap();
        let known = random_codes(frames, seed);
        let is_anchor = |frame: usize| anchors >> (frame % 64) & 1 == 1;
        let masked: Codes = PerPart::from_fn(|part| {
            known[part].iter().enumerate().map(|(f, &code)| if is_anchor(f) { code } else { mask }).collect()
        });
        let (filled, logits) = with_compute(1, |cx| fill(model, cx, &masked)).unwrap();
        for part in Part::ALL {
            prop_assert!(logits[part].iter().all(|v| v.is_finite()));
            for frame in 0..frames {
                prop_assert!(filled[part][frame] < mask);
                prop_assert!(!is_anchor(frame) || filled[part][frame] == known[part][frame]);
            }
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for name in MODELS {
        for precision in [Precision::F32, Precision::Bf16, Precision::Int8] {
            let model = Model::load(name, precision);
            let codes = random_codes(40, 7);
            let mut masked = codes.clone();
            for part in Part::ALL {
                let mask = u16::try_from(model.interp.mask()).unwrap();
                masked[part].iter_mut().enumerate().filter(|(f, _)| f % 6 != 0).for_each(|(_, code)| *code = mask);
            }
            let run = |threads| {
                with_compute(threads, |cx| {
                    let (filled, logits) = fill(&model, cx, &masked).unwrap();
                    (filled, logits, stream(&model, cx, &codes, &[13, 6], 5, 40))
                })
            };
            let one = run(1);
            assert_eq!(one, run(2), "{name} {precision:?}");
            assert_eq!(one, run(3), "{name} {precision:?}");
        }
    }
}

/// An interpolation that is paused between its steps fills the same codes from the same logits, some
/// frames in each step after the layers over all of them.
#[test]
fn steps_fill_what_one_call_fills() {
    const FRAMES: usize = 40;
    for model in &*ALL {
        let layers = model.file.config().interp.temporal_layers;
        let mask = u16::try_from(model.interp.mask()).unwrap();
        let mut masked = random_codes(FRAMES, 9);
        for part in Part::ALL {
            masked[part].iter_mut().enumerate().filter(|(f, _)| f % 3 != 0).for_each(|(_, code)| *code = mask);
        }
        for (first, piece) in [(0, 1), (0, 7), (28, 5), (28, 12), (28, usize::MAX), (39, 2)] {
            let run = |in_steps: bool| {
                let (mut codes, mut steps) = (masked.clone(), 0);
                let mut scratch = model.interp.scratch(FRAMES);
                with_compute(1, |cx| {
                    let Codes { face, hands, upper, lower } = &mut codes;
                    if !in_steps {
                        let codes = PerPart { face: &mut **face, hands, upper, lower };
                        return model.interp.fill_from(cx, &mut scratch, codes, first);
                    }
                    let mut filling = model.interp.begin(&mut scratch, slices(&masked), first, piece)?;
                    loop {
                        steps += 1;
                        let codes = PerPart { face: &mut **face, hands, upper, lower };
                        if !model.interp.step(cx, &mut scratch, codes, &mut filling)? {
                            return Ok(());
                        }
                    }
                })
                .unwrap();
                (codes, PerPart::from_fn(|part| bits(scratch.logits(part))), steps)
            };
            let (whole, cut) = (run(false), run(true));
            assert_eq!((&cut.0, &cut.1), (&whole.0, &whole.1), "{}: from {first} on by {piece}", model.name);
            assert_eq!(cut.2, layers + (FRAMES - first).div_ceil(piece), "{}: steps", model.name);
        }
    }
}

#[test]
fn a_stream_starts_anew_after_a_reset() {
    let model = &ALL[0];
    let (first, codes) = (random_codes(50, 1), random_codes(30, 2));
    with_compute(1, |cx| {
        let want = stream(model, cx, &codes, &[30], 3, 30);
        let decoder = &model.decoder;
        let mut scratch = decoder.scratch(decoder.stream_rows(50, 9));
        let mut state = MotionStream::new(decoder, 50, 9, Smoothing::OFF);
        state.push(cx, decoder, &mut scratch, &latents(&first), 0, &mut |_| ()).unwrap();
        state.reset();
        let mut poses = Vec::new();
        let mut take = |frame: umo_core::FrameRef| poses.push(*frame.pose);
        state.push(cx, decoder, &mut scratch, &latents(&codes), 3, &mut take).unwrap();
        state.finish(cx, decoder, &mut scratch, 30, &mut take).unwrap();
        assert_eq!(poses, want.poses);
    });
}

/// The root's largest displacement between frames along the ground, and its largest change of
/// height.
fn largest_steps(poses: &[Pose]) -> (f32, f32) {
    poses.windows(2).fold((0.0, 0.0), |(ground, height), pair| {
        let [a, b] = [pair[0].translation, pair[1].translation];
        let step = ((a[0] - b[0]).powi(2) + (a[2] - b[2]).powi(2)).sqrt();
        (step.max(ground), (a[1] - b[1]).abs().max(height))
    })
}

#[test]
fn a_seam_is_no_jump() {
    for model in &*ALL {
        let codes = random_codes(90, 3);
        with_compute(1, |cx| {
            let whole = model.decoder.decode(cx, slices(&codes)).unwrap();
            let whole: Vec<Pose> =
                whole.translation.iter().map(|&translation| Pose { translation, ..Pose::REST }).collect();
            let cut = stream(model, cx, &codes, &[30], 0, 90);
            let (whole, cut) = (largest_steps(&whole), largest_steps(&cut.poses));
            println!("steps {}: whole {whole:?}, in pieces {cut:?}", model.name);
            assert!(cut.0 <= 2.0 * whole.0 && cut.1 <= 2.0 * whole.1);
        });
    }
}

#[test]
fn a_seam_fades_linearly_to_the_whole_decode() {
    const CUT: usize = 60;
    for model in &*ALL {
        // One code, then another: the first was repeated in place of the second, so that each part has a
        // seam at the cut.
        let [first, second] = [11, 12].map(|seed| random_codes(1, seed));
        let codes = PerPart::from_fn(|part| [vec![first[part][0]; CUT], vec![second[part][0]; 2 * CUT]].concat());
        let (whole, cut) = with_compute(1, |cx| {
            let whole = model.decoder.decode(cx, slices(&codes)).unwrap();
            (whole, stream(model, cx, &codes, &[CUT, 2 * CUT], 0, 3 * CUT))
        });
        let fades = |name: &str, reach: usize, seam: f32, difference: &dyn Fn(usize) -> f32| {
            for after in 0..reach + 4 {
                let weight = 1.0 - (after + 1).min(reach + 2) as f32 / (reach + 2) as f32;
                let (found, wanted) = (difference(CUT + after), seam * weight);
                let near = (found - wanted).abs() <= 1e-5 * seam.abs().max(1.0);
                assert!(near, "{} {name}: {found} is left {after} frames after a seam of {seam}", model.name);
            }
        };
        for part in Part::ALL {
            let width = model.decoder.channels(part);
            let reach = model.file.config().vq[part].decoder_reach();
            let off = |frame: usize, channel: usize| {
                cut.channels[part][frame * width + channel] - whole.channels[part][frame * width + channel]
            };
            let largest = (0..width).map(|channel| off(CUT - 1, channel).abs()).fold(0.0, f32::max);
            assert!(largest > 0.01, "{} {} has no seam to speak of", model.name, part.name());
            for channel in 0..width {
                fades(part.name(), reach, off(CUT - 1, channel), &|frame| off(frame, channel));
            }
            let row = |of: &PerPart<Vec<f32>>, frame: usize| bits(&of[part][frame * width..(frame + 1) * width]);
            let end = CUT + reach + 1;
            assert_ne!(row(&cut.channels, end - 1), row(&whole.channels, end - 1));
            assert_eq!(row(&cut.channels, end), row(&whole.channels, end), "the fade is over");
        }
        let off = |frame: usize| cut.poses[frame].translation[1] - whole.translation[frame][1];
        let root_reach = model.decoder.root_reach() - model.file.config().vq.lower.decoder_reach();
        assert!(off(CUT - 1).abs() > 1e-3, "{}: the height has no seam to speak of", model.name);
        fades("height", root_reach, off(CUT - 1), &off);
    }
}

/// With a lookahead of the decoders' reach and the filter's, pieces give the bits of one piece; the
/// body's rows are then those of the whole decode, filtered; the face's are not filtered.
#[test]
fn a_smoothed_stream_is_the_whole_decode_filtered_whatever_the_pieces() {
    const FRAMES: usize = 90;
    for model in &*ALL {
        let codes = random_codes(FRAMES, 21);
        for sigma in [0.5_f32, 1.0, 1.5] {
            let smoothing = Smoothing::new(sigma).unwrap();
            let radius = smoothing.radius();
            let lookahead = model.decoder.reach() + radius;
            with_compute(1, |cx| {
                let whole = model.decoder.decode(cx, slices(&codes)).unwrap();
                let run = |sizes: &[usize]| smoothed_stream(model, cx, &codes, sizes, (lookahead, smoothing), FRAMES);
                let got = run(&[FRAMES]);
                for sizes in [&[1][..], &[6, 13], &[30]] {
                    let pieces = run(sizes);
                    assert_eq!(pieces.face, got.face, "{} {sigma} {sizes:?}", model.name);
                    for part in Part::ALL {
                        let same = bits(&pieces.channels[part]) == bits(&got.channels[part]);
                        assert!(same, "{} {sigma} {sizes:?} {}", model.name, part.name());
                    }
                }
                assert_eq!(bits(&got.channels.face), bits(&whole.channels.face), "the face is not filtered");
                let width = model.decoder.channels(Part::Upper);
                for frame in 0..FRAMES {
                    let there = frame.saturating_sub(radius)..(frame + radius + 1).min(FRAMES);
                    let weight =
                        |other: usize| (-0.5 * (frame.abs_diff(other) as f64 / f64::from(sigma)).powi(2)).exp();
                    let sum: f64 = there.clone().map(weight).sum();
                    for channel in 0..width {
                        let value = |other: usize| f64::from(whole.channels.upper[other * width + channel]);
                        let want = there.clone().map(|other| weight(other) * value(other)).sum::<f64>() / sum;
                        let found = f64::from(got.channels.upper[frame * width + channel]);
                        assert!((found - want).abs() < 1e-5 * want.abs().max(1.0), "{} {frame}", model.name);
                    }
                }
            });
        }
    }
}

/// A seam of a smoothed stream continues with the motion's velocity.
#[test]
fn a_smoothed_seam_has_no_corner() {
    for model in &*ALL {
        let codes = random_codes(120, 22);
        let worst = |smoothing: Smoothing| {
            let got = with_compute(1, |cx| smoothed_stream(model, cx, &codes, &[6], (3, smoothing), 120));
            let width = model.decoder.channels(Part::Upper);
            let second =
                got.channels.upper.windows(2 * width + 1).map(|w| (w[2 * width] - 2.0 * w[width] + w[0]).powi(2));
            second.sum::<f32>()
        };
        let [rough, smooth] = [Smoothing::OFF, Smoothing::new(1.5).unwrap()].map(worst);
        assert!(smooth < 0.1 * rough, "{}: {smooth} of {rough} is left", model.name);
    }
}

#[test]
fn bad_codes_are_refused_and_change_nothing() {
    let model = &ALL[0];
    let decoder = &model.decoder;
    let good = random_codes(10, 5);
    with_compute(1, |cx| {
        let mut short = good.clone();
        short.lower.pop();
        let mut outside = good.clone();
        outside.hands[3] = 256;
        assert!(matches!(decoder.decode(cx, slices(&short)), Err(StepError::Disagree(_))));
        assert!(matches!(decoder.decode(cx, slices(&outside)), Err(StepError::OutOfRange { got: 256, .. })));
        assert!(matches!(decoder.decode(cx, slices(&random_codes(0, 0))), Err(StepError::Empty(_))));
        let mut state = MotionStream::new(decoder, 10, 9, Smoothing::OFF);
        let mut scratch = decoder.scratch(decoder.stream_rows(10, 9));
        for bad in [&short, &outside, &random_codes(11, 0)] {
            assert!(state.push(cx, decoder, &mut scratch, &latents(bad), 0, &mut |_| ()).is_err());
            assert_eq!(state.known(), 0);
        }
        assert!(state.push(cx, decoder, &mut scratch, &latents(&good), 10, &mut |_| ()).is_err());
        assert!(state.push(cx, decoder, &mut decoder.scratch(3), &latents(&good), 0, &mut |_| ()).is_err());
        state.push(cx, decoder, &mut scratch, &latents(&good), 9, &mut |_| ()).unwrap();
        assert!(state.finish(cx, decoder, &mut scratch, 11, &mut |_| ()).is_err());
        assert_eq!((state.known(), state.emitted()), (10, 1));
    });
}

#[test]
fn bad_windows_are_not_interpolated() {
    let model = &ALL[0];
    with_compute(1, |cx| {
        let refused = |change: &dyn Fn(&mut Codes)| {
            let mut codes = random_codes(12, 6);
            change(&mut codes);
            fill(model, cx, &codes).unwrap_err()
        };
        assert!(matches!(refused(&|codes| codes.lower[4] = 256), StepError::Disagree(_)));
        assert!(matches!(refused(&|codes| codes.upper.truncate(3)), StepError::Disagree(_)));
        assert!(matches!(refused(&|codes| codes.hands[2] = 257), StepError::OutOfRange { got: 257, limit: 257, .. }));
        assert!(matches!(refused(&|codes| *codes = random_codes(0, 0)), StepError::Empty(_)));
        let limit = model.interp.max_frames();
        let long = refused(&|codes| *codes = random_codes(limit + 1, 0));
        assert_eq!(long, StepError::TooLong { what: "frames to interpolate", got: limit + 1, limit });
    });
}

#[test]
fn a_clip_gives_the_channels_that_it_was_made_from() {
    let model = ALL.iter().find(|model| model.encoder.is_some()).unwrap();
    let config = model.file.config();
    let mut clip = config.clip();
    let face = vec![0.25; config.face.names.len()];
    let mut pose = Pose::REST;
    for frame in 0..9 {
        pose.translation = [0.002 * frame as f32, 1.0, -0.02 * frame as f32];
        pose.rotations[4] = umo_core_pose::rotation::axis_angle_to_quat([0.1 * frame as f32, 0.0, 0.0]);
        clip.push(&pose, &face);
    }
    let channels = clip.channels();
    let width = model.decoder.channels(Part::Lower);
    for (frame, row) in channels.lower.chunks_exact(width).enumerate() {
        let six = [18, 19, 20, 21, 22, 23].map(|i| row[i]);
        let turned = quat_to_axis_angle(umo_core_pose::rotation::six_to_quat(six));
        assert!((turned[0] - 0.1 * frame as f32).abs() < 1e-5, "the knee is the fourth of the lower joints");
        assert!((row[54] - 0.06).abs() < 1e-4 && (row[55] - 1.0).abs() < 1e-6 && (row[56] + 0.6).abs() < 1e-4);
        assert_eq!(row[57..], [0.0; 4], "a foot that moves 2 cm a frame does not stand");
    }
    assert_eq!(channels.face.len(), 9 * model.decoder.channels(Part::Face));
    assert!(channels.face.chunks_exact(58).all(|row| row[6..] == face));

    // At rest, both feet are in contact.
    let mut still = config.clip();
    still.push(&Pose::REST, &face);
    assert_eq!(still.channels().lower[54..], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);

    // Half the rate drops every second frame, and the codes of both clips have the model's rate.
    let half = clip.at_rate(15.0);
    assert_eq!(half.len(), 5);
    assert_eq!(half.translation[2], clip.translation[4]);
    with_compute(1, |cx| {
        let encoder = model.encoder.as_ref().unwrap();
        assert_eq!(encoder.encode_clip(cx, &half).unwrap().face.len(), 9);
        assert_eq!(encoder.encode_clip(cx, &config.clip()), Err(StepError::Empty("motion frames")));
        let odd = |frame_rate| Clip { frame_rate, ..clip.clone() };
        for rate in [0.0, -30.0, f32::NAN, f32::INFINITY, 1e-6] {
            assert!(matches!(encoder.encode_clip(cx, &odd(rate)), Err(StepError::Disagree(_))));
        }
        let mut other = clip.clone();
        other.face.names.pop();
        assert!(matches!(encoder.encode_clip(cx, &other), Err(StepError::Disagree(_))));
    });
}

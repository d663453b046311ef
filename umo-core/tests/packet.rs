//! Packets from a sender to a decoder: the same frames in any order of arrival, and recovery after
//! losses.

use std::path::Path;

use umo_core::{
    Animation, AvatarConfig, Compute, Decoder, FrameRef, Isa, Model, ModelFile, PacketError, PacketLayout, Part,
    Precision, Received, Team,
};

const MODELS: [&str; 5] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k2_arkit", "frames_four", "frames_seven"];
const FRAMES: usize = 200;

fn open(name: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name).join("model.safetensors");
    Model::load(&ModelFile::open(&path).unwrap(), Precision::Stored, Isa::detect()).unwrap()
}

/// A frame's bits: number, root position, rotations, face, channels.
#[derive(Clone, Debug, PartialEq)]
struct Bits {
    index: usize,
    place: [f32; 3],
    rest: Vec<u32>,
}

fn bits(frame: FrameRef) -> Bits {
    let channels = Part::ALL.iter().flat_map(|&part| frame.channels[part]);
    let values = frame.pose.rotations.as_flattened().iter().chain(frame.face).chain(channels);
    Bits { index: frame.index, place: frame.pose.translation, rest: values.map(|value| value.to_bits()).collect() }
}

/// A sender's packets and frames.
struct Sent {
    packets: Vec<Vec<u8>>,
    frames: Vec<Bits>,
}

/// Settings at the model's lookahead, without layers.
fn settings(model: &Model, target: usize, lookahead: usize) -> AvatarConfig {
    let mut config = AvatarConfig::new(model.config());
    (config.target, config.lookahead) = (target, lookahead);
    config.smoothing = 1.2;
    config
}

fn send(model: &Model, config: &AvatarConfig, stream: u8, history: usize, late_end: bool) -> Sent {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let samples = FRAMES * model.config().audio.sample_rate / model.config().frame_rate;
    let mut animation = Animation::new(model, config).unwrap();
    animation.push_audio(&(0..samples).map(|i| 0.3 * (i as f32 * 0.07).sin()).collect::<Vec<_>>()).unwrap();
    let layout = PacketLayout::new(model);
    let mut sent = Sent { packets: Vec::new(), frames: Vec::new() };
    if !late_end {
        animation.finish(FRAMES);
    }
    loop {
        let mut frames = Vec::new();
        if !animation.step(model, cx, &mut |frame: FrameRef| frames.push(bits(frame))).unwrap() {
            assert_eq!(animation.packet(model, &layout, (stream, history), &mut [0; 4096]).unwrap(), None);
            if !late_end || sent.frames.len() == FRAMES {
                return sent;
            }
            animation.finish(FRAMES);
            continue;
        }
        sent.frames.append(&mut frames);
        let mut bytes = [0; 4096];
        let len = animation.packet(model, &layout, (stream, history), &mut bytes).unwrap().unwrap();
        sent.packets.push(bytes[..len].to_vec());
    }
}

/// Frames that a decoder makes of packets.
fn receive<'a>(
    model: &Model,
    config: &AvatarConfig,
    reorder_window: usize,
    packets: impl IntoIterator<Item = &'a Vec<u8>>,
) -> (Vec<Bits>, Received, bool) {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut decoder = Decoder::new(model, config, reorder_window).unwrap();
    let mut frames = Vec::new();
    for packet in packets {
        decoder.push_packet(model, cx, packet, &mut |frame: FrameRef| frames.push(bits(frame))).unwrap();
    }
    (frames, decoder.received(), decoder.is_over())
}

#[test]
fn a_decoder_has_the_senders_bits() {
    for name in MODELS {
        let model = open(name);
        let most = model.config().max_target.min(3);
        for (target, lookahead) in [(1, 0), (most, 9), (2.min(most), 3)] {
            for (history, late_end) in [(0, false), (2, true)] {
                let config = settings(&model, target, lookahead);
                let sent = send(&model, &config, 7, history, late_end);
                assert_eq!(sent.frames.len(), FRAMES, "{name}");
                let (frames, received, is_over) = receive(&model, &config, 0, &sent.packets);
                assert!(frames == sent.frames, "{name}, target {target}, history {history}");
                assert!(is_over);
                assert_eq!(received.packets, sent.packets.len() as u64);
                assert_eq!((received.late, received.lost, received.held), (0, 0, 0));
            }
        }
    }
}

#[test]
fn order_and_repetition_change_nothing() {
    for name in ["mel_k2_arkit", "frames_seven"] {
        let model = open(name);
        let config = settings(&model, 1, 3);
        let sent = send(&model, &config, 255, 1, false);
        // Neighbours swapped, and each packet twice.
        let mut packets = sent.packets.clone();
        packets.chunks_mut(4).filter(|four| four.len() > 1).for_each(|four| four.swap(0, 1));
        let twice: Vec<_> = packets.iter().flat_map(|packet| [packet, packet]).collect();
        let (frames, received, is_over) = receive(&model, &config, 1, twice.iter().copied());
        assert!(frames == sent.frames && is_over, "{name}");
        assert_eq!((received.late, received.lost), (packets.len() as u64, 0), "{name}");
        // Groups of three, reversed.
        let mut packets = sent.packets.clone();
        packets.chunks_mut(3).for_each(<[_]>::reverse);
        let (frames, received, _) = receive(&model, &config, 2, &packets);
        assert!(frames == sent.frames, "{name}");
        assert_eq!((received.late, received.lost), (0, 0), "{name}");
    }
}

#[test]
fn what_the_next_packet_says_again_is_not_lost() {
    for name in ["hubert_k1_smplx", "frames_seven"] {
        let model = open(name);
        for (target, run) in [(1, 2), (2, 1)] {
            let config = settings(&model, target, 3);
            let sent = send(&model, &config, 1, 2, false);
            // Every third packet, or two of four in a row.
            let lost = |at: usize| if run == 1 { at % 3 == 1 } else { at % 4 == 1 || at % 4 == 2 };
            let last = sent.packets.len() - 1;
            let kept =
                sent.packets.iter().enumerate().filter(|&(at, _)| at == last || !lost(at)).map(|(_, packet)| packet);
            let (frames, received, is_over) = receive(&model, &config, 0, kept);
            assert!(frames == sent.frames && is_over, "{name}");
            assert!(received.lost > 5 && received.held == 0, "{name}: {received:?}");
        }
    }
}

#[test]
fn a_loss_is_held_and_heals() {
    for name in ["mel_k2_arkit", "frames_four", "frames_seven"] {
        let model = open(name);
        // Lookahead without seams: a seam would carry a share of the error for longer.
        let held_back = model.motion().reach() + 3;
        let config = settings(&model, 1, held_back);
        let stride = model.config().keyframe_stride;
        let sent = send(&model, &config, 1, 0, false);
        let (first, count) = (6, 3);
        let kept =
            sent.packets.iter().enumerate().filter(|(at, _)| !(first..first + count).contains(at)).map(|(_, p)| p);
        let (frames, received, is_over) = receive(&model, &config, 0, kept);
        assert_eq!((received.lost, received.held), (count as u64, count as u64), "{name}");
        assert!(is_over && frames.len() == FRAMES, "{name}");
        assert!(frames.iter().enumerate().all(|(at, frame)| frame.index == at), "{name}");
        // Frames before the loss are unchanged, and some after it differ.
        let known = (first - 1) * stride + 1 - held_back;
        assert!(frames[..known] == sent.frames[..known], "{name}");
        assert!(frames.iter().zip(&sent.frames).any(|(a, b)| a.rest != b.rest), "{name}");
        // A chunk later the root is at the sender's position.
        let healed = (first + count + 3) * stride;
        let off = |at: usize| {
            let (a, b) = (frames[at].place, sent.frames[at].place);
            (a[0] - b[0]).abs().max((a[2] - b[2]).abs())
        };
        let lost = (first * stride..healed).map(off).fold(0.0, f32::max);
        let after = (healed..FRAMES).map(off).fold(0.0, f32::max);
        assert!(after <= 0.5 * lost + 3e-4, "{name}: {after} m after {lost} m");
        // When the last wrong keyframe has left the window, every bit is right except the root's position.
        let gone = (first + count + model.config().prefix + 1) * stride + 2 * held_back;
        assert!(gone + 10 < FRAMES, "{name}");
        let same = frames[gone..].iter().zip(&sent.frames[gone..]).all(|(a, b)| a.rest == b.rest);
        assert!(same, "{name}");
    }
}

#[test]
fn a_long_loss_begins_anew() {
    let model = open("frames_seven");
    let config = settings(&model, 1, 3);
    let sent = send(&model, &config, 1, 2, false);
    let lost = model.config().prefix + 4;
    let kept = sent.packets.iter().enumerate().filter(|(at, _)| !(3..3 + lost).contains(at)).map(|(_, packet)| packet);
    let (frames, received, is_over) = receive(&model, &config, 0, kept);
    assert!(is_over);
    assert_eq!((received.lost, received.held), (lost as u64, lost as u64 - 2));
    let start = (3 + lost) * model.config().keyframe_stride;
    let gap = frames.windows(2).filter(|pair| pair[1].index != pair[0].index + 1).collect::<Vec<_>>();
    assert_eq!((gap.len(), gap[0][1].index), (1, start));
    assert_eq!(frames.last().unwrap().index, FRAMES - 1);
    let (last, wanted) = (frames.last().unwrap().place, sent.frames.last().unwrap().place);
    assert!((last[0] - wanted[0]).abs() < 0.2 && (last[2] - wanted[2]).abs() < 0.2, "{last:?} {wanted:?}");
}

#[test]
fn a_later_stream_replaces_the_one_before() {
    let model = open("mel_k2_arkit");
    let config = settings(&model, 2, 3);
    let (before, after) = (send(&model, &config, 255, 1, false), send(&model, &config, 0, 1, false));
    let packets = before.packets[..4].iter().chain(&after.packets).chain(&before.packets[4..]);
    let (frames, received, is_over) = receive(&model, &config, 0, packets);
    let first = frames.iter().rposition(|frame| frame.index == 0).unwrap();
    assert!(frames[first..] == after.frames && is_over);
    assert_eq!(received.late, before.packets.len() as u64 - 4);
}

#[test]
fn packets_of_others_are_refused_and_change_nothing() {
    let (model, other) = (open("mel_k2_arkit"), open("frames_seven"));
    let config = settings(&model, 1, 3);
    let sent = send(&model, &config, 1, 0, false);
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let foreign = send(&other, &settings(&other, 1, 3), 1, 0, false);
    let wider = send(&model, &settings(&model, 2, 3), 1, 0, false);
    let mut decoder = Decoder::new(&model, &config, 0).unwrap();
    let mut frames = Vec::new();
    for packet in &sent.packets {
        let mut push =
            |bytes: &[u8]| decoder.push_packet(&model, cx, bytes, &mut |frame: FrameRef| frames.push(bits(frame)));
        assert_eq!(push(&foreign.packets[0]), Err(PacketError::Other("model")));
        assert_eq!(push(&wider.packets[0]), Err(PacketError::Other("target")));
        assert!(matches!(push(&packet[..packet.len() - 1]), Err(PacketError::Malformed(_))));
        push(packet).unwrap();
    }
    assert!(frames == sent.frames);
    assert!(Decoder::new(&model, &config, 5).unwrap_err().to_string().contains("reorder_window"));
}

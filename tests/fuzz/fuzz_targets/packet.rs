//! Any bytes as packets of a stream: errors or frames, never a panic or a frame out of order.
#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use umo_core::{AvatarConfig, Compute, Decoder, FrameRef, Isa, Model, ModelFile, PacketLayout, Precision, Team};

static BYTES: &[u8] = include_bytes!("../../golden/frames_seven/model.safetensors");
static MODEL: OnceLock<(Model, Team)> = OnceLock::new();

/// Maximum number of frames in one run: a packet may claim that very many chunks were lost.
const MOST: usize = 4000;

fuzz_target!(|data: &[u8]| {
    let (model, team) = MODEL.get_or_init(|| {
        let file = ModelFile::from_bytes(BYTES.to_vec()).expect("a golden model");
        let model = Model::load(&file, Precision::Stored, Isa::detect()).expect("a golden model");
        (model, Team::new(1).expect("no thread is needed"))
    });
    let cx = Compute { isa: model.isa(), team };
    let Some((&first, mut rest)) = data.split_first() else { return };
    let mut config = AvatarConfig::new(model.config());
    (config.target, config.lookahead) = (1 + usize::from(first & 1), usize::from(first >> 1 & 7));
    let mut decoder = Decoder::new(model, &config, usize::from(first >> 4) % 5).expect("sound settings");
    let mut next = 0;
    // A length before each packet; the model's number is inserted, because a fuzzer would not guess it.
    let mut sound = vec![0; 64];
    let layout = PacketLayout::new(model);
    let head = umo_core::PacketHead {
        is_prompted: false,
        stream: 0,
        sequence: 0,
        sample: 0,
        root: [0.0; 2],
        keyframes: 0,
        history: 0,
        total: Some(0),
        mouth_frames: 0,
        mouth_back: 0,
    };
    layout.encode(&head, &[], &[], &[], &mut sound).expect("there is room");
    while let Some((&len, more)) = rest.split_first() {
        let (packet, more) = more.split_at(usize::from(len).min(more.len()));
        rest = more;
        let mut packet = packet.to_vec();
        if packet.len() > 4 {
            packet[2..4].copy_from_slice(&sound[2..4]);
        }
        let mut begins = true;
        let pushed = decoder.push_packet(model, cx, &packet, &mut |frame: FrameRef| {
            // Only a new or restarted stream may break the order.
            assert!(frame.index >= next || begins, "frame {} after {next}", frame.index);
            assert!(frame.pose.translation.iter().all(|v| v.is_finite()));
            (next, begins) = (frame.index + 1, false);
        });
        if pushed.is_err_and(|error| matches!(error, umo_core::PacketError::Step(_))) {
            decoder.reset();
        }
        if next > MOST {
            return;
        }
    }
});

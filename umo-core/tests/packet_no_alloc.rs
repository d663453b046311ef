//! Writing packets and decoding them allocates nothing: with losses, repetitions and new streams.

mod counting;

use std::path::Path;

use counting::{allocator_calls, check_counter};
use umo_core::motion::FrameRef;
use umo_core::{Animation, AvatarConfig, Compute, Decoder, Isa, Model, ModelFile, Precision, Team};

fn main() {
    check_counter();
    for name in ["hubert_k3_i8", "mel_k2_arkit", "frames_seven"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name).join("model.safetensors");
        let model = Model::load(&ModelFile::open(&path).expect("a golden model"), Precision::Stored, Isa::detect());
        run(&model.expect("a golden model"), name);
    }
    println!("no allocation in streams of packets");
}

fn run(model: &Model, name: &str) {
    let team = Team::new(1).expect("no thread is needed");
    let cx = Compute { isa: model.isa(), team: &team };
    let config = AvatarConfig::new(model.config());
    let layout = model.packets();
    let mut packets = Vec::new();
    for stream in [3, 4] {
        let mut animation = Animation::new(model, &config).expect("sound settings");
        animation.push_audio(&vec![0.1; 3 * model.config().audio.sample_rate]).expect("no end yet");
        animation.finish(80);
        while animation.step(model, cx, &mut |_: FrameRef| ()).expect("a sound model") {
            let mut bytes = vec![0; 4096];
            let mut len = None;
            let calls = allocator_calls(|| {
                len = animation.packet(model, &layout, (stream, 1), &mut bytes).expect("there is room");
            });
            assert_eq!(calls, 0, "{name}: writing a packet");
            bytes.truncate(len.expect("a chunk was computed"));
            packets.push(bytes);
        }
    }
    let mut decoder = Decoder::new(model, &config, 2).expect("sound settings");
    let mut frames = 0;
    let calls = allocator_calls(|| {
        for (at, packet) in packets.iter().enumerate() {
            if at % 4 != 2 {
                for _ in 0..2 {
                    decoder.push_packet(model, cx, packet, &mut |_: FrameRef| frames += 1).expect("a good packet");
                }
            }
            decoder.push_packet(model, cx, &packet[1..], &mut |_: FrameRef| ()).expect_err("no packet");
        }
    });
    assert_eq!(calls, 0, "{name}: decoding packets");
    assert!(frames > 80, "{name}: {frames} frames");
}

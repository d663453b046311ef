//! Writing and decoding packets never allocates, with losses, repetitions and new streams; nor do
//! sessions that send packets or play them, or record a take or play one.

mod counting;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use counting::{allocator_calls, check_counter};
use umo_core::{
    Animation, AvatarConfig, Compute, Decoder, Edit, Engine, EngineConfig, Event, FrameRef, GestureOptions, Isa, Model,
    ModelFile, Mood, PacketConfig, PacketLayout, Poll, Precision, Session, SessionConfig, Take, Team, Threads,
};

fn main() {
    check_counter();
    for name in ["hubert_k3_i8", "mel_k2_arkit", "frames_seven"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name).join("model.safetensors");
        let model = Model::load(&ModelFile::open(&path).expect("a golden model"), Precision::Stored, Isa::detect());
        let model = Arc::new(model.expect("a golden model"));
        run(&model, name);
        sessions(&model, name);
        takes(&model, name);
    }
    println!("no allocation in streams of packets");
}

fn run(model: &Model, name: &str) {
    let team = Team::new(1).expect("no thread is needed");
    let cx = Compute { isa: model.isa(), team: &team };
    let config = AvatarConfig::new(model.config());
    let layout = PacketLayout::new(model);
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
            decoder.push_packet(model, cx, &packet[1..], &mut |_: FrameRef| ()).expect_err("not a packet");
        }
    });
    assert_eq!(calls, 0, "{name}: decoding packets");
    assert!(frames > 80, "{name}: {frames} frames");
}

/// A sender, and a receiver that gets three of four packets, some of them twice, with an interrupt in
/// the middle; all layers are on.
fn sessions(model: &Arc<Model>, name: &str) {
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).expect("no thread is needed");
    let mut config = SessionConfig::new(model.config());
    config.reorder_window = 1;
    let decoder = Session::decoder(model, &config).expect("sound settings");
    config.packets = Some(PacketConfig { with_frames: false, ..PacketConfig::new(config.avatar.target) });
    let sender = engine.session(&config).expect("sound settings");
    let audio = vec![0.1; model.config().audio.sample_rate / 10];
    let (mut bytes, mut lengths) = (vec![0; 4 * sender.packet_size()], [0; 4]);
    let (mut sent, mut shown, mut refused) = (0_u32, 0, 0);
    let calls = allocator_calls(|| {
        for tenth in 0..60_u32 {
            sender.push_audio(&audio).expect("one thread pushes");
            if tenth == 30 {
                sender.interrupt(Duration::from_millis(100)).expect("the session is sound");
            }
            while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
            let count = sender.pull_packets(&mut bytes, &mut lengths).expect("one thread pulls");
            let mut at = 0;
            for &len in &lengths[..count] {
                for _ in 0..sent % 4 {
                    decoder.push_packet(&bytes[at..at + len]).expect("a good packet");
                }
                refused += usize::from(decoder.push_packet(&bytes[at + 1..at + len]).is_err());
                (sent, at) = (sent + 1, at + len);
            }
            let seconds = f64::from(tenth) / 10.0;
            decoder.set_clock(seconds).expect("a time");
            decoder.sample_pose(seconds - 1.0, |_| ()).expect("one thread samples");
            shown += decoder.pull_frames(2, |_| ()).expect("one thread pulls");
        }
    });
    assert_eq!(calls, 0, "{name}: sessions");
    let received = decoder.received().expect("one thread pushes");
    assert!(
        sent > 10 && refused == sent as usize && shown > 50 && received.lost > 0,
        "{name}: {sent} {shown} {received:?}"
    );
}

/// A session that records a take with requests, and one that plays it twice; all layers are on.
fn takes(model: &Arc<Model>, name: &str) {
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &config).expect("no thread is needed");
    let config = SessionConfig { take_bytes: 1 << 14, ..SessionConfig::new(model.config()) };
    let session = engine.session(&config).expect("sound settings");
    let audio = vec![0.1; model.config().audio.sample_rate / 10];
    let (mut bytes, mut length, mut frames) = (vec![0; 1 << 15], 0, 0);
    let calls = allocator_calls(|| {
        for tenth in 0..30_u32 {
            session.push_audio(&audio).expect("one thread pushes");
            match tenth {
                3 => session.hint_words("no, never", 0.6, 1.2).expect("there is room"),
                5 => session.play_gesture("wave", &GestureOptions::default()).expect("there is room"),
                9 => session.set_mood(Mood::Joy, 1.0).expect("a strength"),
                _ => {}
            }
            while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
            frames += session.pull_frames(5, |_| ()).expect("one thread pulls");
        }
        length = session.take(&mut bytes).expect("there is room");
    });
    assert_eq!(calls, 0, "{name}: a take is recorded");
    let take = Take::new(&bytes[..length]).expect("a take");
    assert!(frames > 30 && take.info().frames as usize == frames, "{name}: {frames}");
    played(model, &take, name);
    let events = take.events().filter(|(_, event)| !matches!(event, Event::Mood { .. })).collect();
    let edit = Edit {
        phases: take.phases(model).unwrap_or_default(),
        events: Some(events),
        windows: std::iter::once(10..25).collect(),
        ..Edit::default()
    };
    let team = Team::new(1).expect("no thread is needed");
    let cx = Compute { isa: model.isa(), team: &team };
    let samples = vec![0.1; 3 * model.config().audio.sample_rate];
    let edited = take.edited(model, cx, &samples, &edit).expect("its recording");
    assert!(edited.is_edited(), "{name}");
    played(model, &edited, name);
}

/// Plays a take twice.
fn played(model: &Arc<Model>, take: &Take, name: &str) {
    let frames = take.info().frames as usize;
    let player = Session::of_take(model, take, &SessionConfig::new(model.config())).expect("its model");
    let mut shown = 0;
    let calls = allocator_calls(|| {
        for _ in 0..2 {
            while !player.is_done().expect("it is sound") {
                player.push_take().expect("good packets");
                shown += player.pull_frames(3, |_| ()).expect("one thread pulls");
            }
            player.reset().expect("it is sound");
        }
    });
    assert_eq!((calls, shown), (0, 2 * frames), "{name}: a take is played");
}

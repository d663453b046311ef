//! Sessions that send packets, and sessions that play them: without loss, the sender's bits; over a
//! bad network, no jumps, and recovery within a chunk.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use umo_core::{
    Engine, EngineConfig, Frame, Isa, LayerGains, Model, ModelFile, PacketConfig, PacketError, Poll, Precision,
    Session, SessionConfig, SessionError, Threads,
};

/// The default model, and small ones of random weights in both layouts.
const PEOPLE: &str = "../models/umo-people/model.safetensors";
const SMALL: [&str; 2] =
    ["../tests/golden/mel_k2_arkit/model.safetensors", "../tests/golden/frames_seven/model.safetensors"];

fn open(path: &str) -> Arc<Model> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    Arc::new(Model::load(&ModelFile::open(&path).unwrap(), Precision::Stored, Isa::detect()).unwrap())
}

fn engine(model: &Arc<Model>) -> Engine {
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    Engine::new(Arc::clone(model), &config).unwrap()
}

fn compute(engine: &Engine) {
    while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
}

/// Speech: the repository's sentence, a second of silence, and the sentence again.
fn speech() -> Vec<f32> {
    let bytes = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hello.wav")).unwrap();
    // 16 kHz, mono, 16 bits, behind a header of 44 bytes.
    assert_eq!((&bytes[..4], &bytes[36..40]), (&b"RIFF"[..], &b"data"[..]));
    let samples = bytes[44..].as_chunks::<2>().0.iter().map(|&bytes| f32::from(i16::from_le_bytes(bytes)) / 32768.0);
    let samples: Vec<f32> = samples.collect();
    [&samples[..], &[0.0; 16_000], &samples].concat()
}

/// Joints of the eyes.
const EYES: [usize; 2] = [23, 24];

/// A displayed frame, as bits.
#[derive(Clone, Debug, PartialEq)]
struct Shown {
    index: u64,
    sample: u64,
    place: [f32; 3],
    rotations: Vec<[f32; 4]>,
    face: Vec<f32>,
}

impl Shown {
    fn new(frame: Frame) -> Self {
        let (index, sample, place) = (frame.index, frame.sample, frame.pose.translation);
        Self { index, sample, place, rotations: frame.pose.rotations.to_vec(), face: frame.face.to_vec() }
    }

    /// Largest angle between a joint in both frames, degrees, without the eyes, whose saccades are
    /// jumps.
    fn angle(&self, other: &Self) -> f32 {
        let pairs = self.rotations.iter().zip(&other.rotations).enumerate();
        let chord = |(a, b): (&[f32; 4], &[f32; 4])| {
            let [plus, minus] =
                [1.0, -1.0].map(|sign| a.iter().zip(b).map(|(a, b)| (a - sign * b).powi(2)).sum::<f32>());
            plus.min(minus).sqrt()
        };
        let largest = pairs.filter(|(joint, _)| !EYES.contains(joint)).map(|(_, pair)| chord(pair)).fold(0.0, f32::max);
        4.0 * (0.5 * largest).asin().to_degrees()
    }

    /// Distance between both roots, metres.
    fn way(&self, other: &Self) -> f32 {
        self.place.iter().zip(&other.place).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
    }
}

fn pull(session: &Session) -> Vec<Shown> {
    let mut frames = Vec::new();
    session.pull_frames(usize::MAX, |frame| frames.push(Shown::new(frame))).unwrap();
    frames
}

fn packets(session: &Session) -> Vec<Vec<u8>> {
    let (mut bytes, mut lengths) = (vec![0; 3 * session.packet_size()], [0; 9]);
    let mut found = Vec::new();
    loop {
        let count = session.pull_packets(&mut bytes, &mut lengths).unwrap();
        if count == 0 {
            return found;
        }
        let mut at = 0;
        for &len in &lengths[..count] {
            found.push(bytes[at..at + len].to_vec());
            at += len;
        }
    }
}

/// Settings of both sides.
fn settings(model: &Model, gains: LayerGains) -> SessionConfig {
    let mut config = SessionConfig::new(model.config());
    config.layers = gains;
    config
}

fn sending(config: &SessionConfig, with_frames: bool) -> SessionConfig {
    let packets = PacketConfig { with_frames, ..PacketConfig::new(config.avatar.target) };
    SessionConfig { packets: Some(packets), ..config.clone() }
}

#[test]
fn a_decoder_has_the_senders_frames() {
    for path in SMALL.into_iter().chain([PEOPLE]) {
        let model = open(path);
        let (engine, config) = (engine(&model), settings(&model, LayerGains::OFF));
        let sender = engine.session(&sending(&config, true)).unwrap();
        let server = engine.session(&sending(&config, false)).unwrap();
        let plain = engine.session(&config).unwrap();
        let decoder = Session::decoder(&model, &config).unwrap();
        let (mut sent, mut silent) = (Vec::new(), Vec::new());
        let (mut shown, mut wanted, mut without) = (Vec::new(), Vec::new(), Vec::new());
        let samples = speech();
        for (piece, part) in samples.chunks(1700).enumerate() {
            for session in [&sender, &server, &plain] {
                session.push_audio(part).unwrap();
                if (piece + 1) * 1700 >= samples.len() {
                    session.finish().unwrap();
                }
            }
            compute(&engine);
            for packet in packets(&sender) {
                decoder.push_packet(&packet).unwrap();
                sent.push(packet);
            }
            shown.extend(pull(&decoder));
            wanted.extend(pull(&sender));
            silent.extend(packets(&server));
            assert_eq!(pull(&server), []);
            without.extend(pull(&plain));
        }
        let frames = (samples.len() * 30 / 16_000) as u64;
        assert_eq!(wanted.len() as u64, frames, "{path}");
        assert!(shown == wanted, "{path}");
        assert!(without == wanted, "{path}: packets change the frames");
        // The last packet's root is that of the stream's last frame, although the chunk extends beyond it.
        let (last, end) = (sent.last().unwrap(), wanted.last().unwrap().place);
        let [x, z] = [16, 20].map(|at| f32::from_le_bytes(*last[at..].first_chunk().unwrap()));
        assert_eq!([x, z], [end[0], end[2]], "{path}");
        // A session without frames sends the same packets.
        assert!(silent == sent, "{path}");
        for session in [&sender, &server, &plain, &decoder] {
            assert_eq!(session.is_done(), Ok(true), "{path}");
        }
        let received = decoder.received().unwrap();
        assert_eq!((received.packets, received.late, received.lost), (sent.len() as u64, 0, 0), "{path}");
        assert_eq!((decoder.stats().chunks, decoder.stats().frames), (sent.len() as u64, frames), "{path}");
    }
}

/// With layers the receiver's frames move like the sender's: packets carry the voice's level.
#[test]
fn layers_are_the_receivers_own() {
    let model = open(PEOPLE);
    let (engine, config) = (engine(&model), settings(&model, LayerGains::ON));
    let sender = engine.session(&sending(&config, true)).unwrap();
    let decoder = Session::decoder(&model, &config).unwrap();
    sender.push_audio(&speech()[..16_000 * 7]).unwrap();
    sender.finish().unwrap();
    let mut worst = 0.0_f32;
    let mut blinks = [0.0_f32; 2];
    let blink = model.config().face.names.iter().position(|name| name == "eyeBlinkLeft").unwrap();
    loop {
        compute(&engine);
        packets(&sender).iter().for_each(|packet| decoder.push_packet(packet).unwrap());
        let (wanted, shown) = (pull(&sender), pull(&decoder));
        assert_eq!(wanted.len(), shown.len());
        for (a, b) in wanted.iter().zip(&shown) {
            worst = worst.max(a.angle(b));
            blinks = [blinks[0].max(a.face[blink]), blinks[1].max(b.face[blink])];
        }
        if wanted.is_empty() {
            break;
        }
    }
    assert!(blinks.iter().all(|&most| most > 0.5), "nobody blinked: {blinks:?}");
    // An accent's strength depends on the level, which a packet rounds and averages over a keyframe; the
    // layers draw the same random numbers.
    println!("{worst} degrees apart");
    assert!(worst < 5.0, "{worst} degrees apart");
}

#[test]
fn an_interrupt_of_the_sender_is_eased_to() {
    let model = open(PEOPLE);
    let (engine, config) = (engine(&model), settings(&model, LayerGains::OFF));
    let sender = engine.session(&sending(&config, false)).unwrap();
    let decoder = Session::decoder(&model, &config).unwrap();
    let samples = speech();
    let mut frames = Vec::new();
    sender.push_audio(&samples[..48_000]).unwrap();
    compute(&engine);
    packets(&sender).iter().for_each(|packet| decoder.push_packet(packet).unwrap());
    frames.extend(pull(&decoder));
    // Computed but unsent packets are dropped.
    sender.push_audio(&samples[48_000..64_000]).unwrap();
    compute(&engine);
    sender.interrupt(Duration::from_millis(200)).unwrap();
    assert_eq!(packets(&sender).len(), 0);
    sender.push_audio(&samples[..32_000]).unwrap();
    sender.finish().unwrap();
    compute(&engine);
    let sent = packets(&sender);
    assert!(!sent.is_empty());
    sent.iter().for_each(|packet| decoder.push_packet(packet).unwrap());
    frames.extend(pull(&decoder));
    assert_eq!((sender.is_done(), decoder.is_done()), (Ok(true), Ok(true)));
    assert!(frames.windows(2).all(|pair| pair[1].index == pair[0].index + 1));
    let jump = frames.windows(2).map(|pair| pair[0].angle(&pair[1])).fold(0.0, f32::max);
    println!("{jump} degrees in a frame");
    assert!(jump < 25.0, "{jump} degrees in a frame");
    // A decoder's host cannot interrupt, and may reset.
    assert_eq!(decoder.interrupt(Duration::ZERO), Err(SessionError::IsDecoder));
    decoder.reset().unwrap();
    sender.reset().unwrap();
    sender.push_audio(&samples[..32_000]).unwrap();
    compute(&engine);
    packets(&sender).iter().for_each(|packet| decoder.push_packet(packet).unwrap());
    assert_eq!(pull(&decoder)[0].index, 0);
}

#[test]
fn a_viewer_may_come_in_the_middle() {
    let model = open(PEOPLE);
    let (engine, config) = (engine(&model), settings(&model, LayerGains::OFF));
    let sender = engine.session(&sending(&config, true)).unwrap();
    let decoder = Session::decoder(&model, &config).unwrap();
    sender.push_audio(&speech()[..16_000 * 8]).unwrap();
    sender.finish().unwrap();
    let mut wanted = Vec::new();
    let mut shown = Vec::new();
    let mut seen = 0;
    for _ in 0..100 {
        compute(&engine);
        for packet in packets(&sender) {
            seen += 1;
            if seen > 6 {
                decoder.push_packet(&packet).unwrap();
            }
        }
        wanted.extend(pull(&sender));
        shown.extend(pull(&decoder));
    }
    let (n, stride) = (config.avatar.target, model.config().keyframe_stride);
    let first = &shown[0];
    assert_eq!(first.index, (6 * n * stride) as u64);
    assert_eq!(decoder.received().unwrap().lost, 0);
    // A second later it shows the sender's frames, except for the root's position.
    let from = 6 * n * stride + 30;
    for (a, b) in wanted[from..].iter().zip(&shown[30..]) {
        assert!(a.index == b.index && a.rotations == b.rotations && a.face == b.face, "frame {}", a.index);
        assert!(a.way(b) < 0.01, "frame {}: {} m", a.index, a.way(b));
    }
}

#[test]
fn what_does_not_fit_is_refused_and_nothing_is_lost() {
    let model = open(SMALL[1]);
    let engine = engine(&model);
    let config = settings(&model, LayerGains::OFF);
    let sender = engine.session(&sending(&config, true)).unwrap();
    let other = engine.session(&config).unwrap();
    let decoder = Session::decoder(&model, &config).unwrap();
    // Calls that belong to the other kind of session.
    assert_eq!(decoder.push_audio(&[0.0]).map(drop), Err(SessionError::IsDecoder));
    assert_eq!(decoder.finish(), Err(SessionError::IsDecoder));
    assert_eq!(decoder.save(&mut []).map(drop), Err(SessionError::IsDecoder));
    assert_eq!(other.push_packet(&[]), Err(SessionError::NotDecoder));
    assert_eq!(other.received().map(drop), Err(SessionError::NotDecoder));
    assert_eq!(other.pull_packets(&mut [], &mut []), Err(SessionError::NoPackets));
    let short = SessionError::Short { needed: sender.packet_size() };
    assert_eq!(sender.pull_packets(&mut [0; 8], &mut [0]), Err(short));
    assert_eq!((other.packet_size(), decoder.packet_size()), (0, 0));
    assert!(Session::decoder(&model, &sending(&config, true)).is_err());
    let patient = SessionConfig { reorder_window: 5, ..config.clone() };
    assert!(Session::decoder(&model, &patient).unwrap_err().to_string().contains("reorder_window"));
    // Invalid packets, and a full queue.
    let (mut wanted, mut shown, mut refused) = (Vec::new(), Vec::new(), 0);
    for part in speech().chunks(16_000) {
        let mut rest = part;
        while !rest.is_empty() {
            rest = &rest[sender.push_audio(rest).unwrap().taken..];
            compute(&engine);
            wanted.extend(pull(&sender));
            for packet in packets(&sender) {
                let bad = decoder.push_packet(&packet[1..]);
                assert!(matches!(bad, Err(SessionError::Packet(PacketError::Malformed(_)))), "{bad:?}");
                while let Err(error) = decoder.push_packet(&packet) {
                    assert_eq!(error, SessionError::Packet(PacketError::Full));
                    refused += 1;
                    shown.extend(pull(&decoder));
                }
            }
        }
    }
    shown.extend(pull(&decoder));
    assert!(refused > 0 && shown == wanted, "{refused} refused");
}

#[test]
fn states_of_senders_have_their_packets() {
    let model = open(SMALL[1]);
    let engine = engine(&model);
    let config = settings(&model, LayerGains::ON);
    let (first, second) = (engine.session(&sending(&config, true)), engine.session(&sending(&config, true)));
    let (first, second) = (first.unwrap(), second.unwrap());
    let plain = engine.session(&config).unwrap();
    first.push_audio(&speech()[..20_000]).unwrap();
    compute(&engine);
    let mut state = vec![0; first.state_size()];
    let len = first.save(&mut state).unwrap();
    assert!(plain.restore(&state[..len]).is_err());
    second.restore(&state[..len]).unwrap();
    let mut sent = Vec::new();
    for session in [&first, &second] {
        session.push_audio(&speech()[20_000..40_000]).unwrap();
        session.finish().unwrap();
        compute(&engine);
        let mut all = packets(session);
        pull(session);
        compute(&engine);
        all.extend(packets(session));
        sent.push(all);
    }
    assert!(sent[0].len() > 3 && sent[0] == sent[1]);
}

/// A local generator, so that the same packets are lost on every machine.
struct Dice(u64);

impl Dice {
    /// A number in 0..1.
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / (1_u64 << 24) as f64
    }
}

/// Delay and losses of a network.
#[derive(Clone, Copy, Debug)]
struct Network {
    loss: f64,
    doubled: f64,
    /// Largest delay of a packet, seconds.
    delay: f64,
    /// When losses end, seconds.
    until: f64,
    seed: u64,
}

/// Pictures per second.
const PICTURES: usize = 60;

/// Packets that become ready with each picture's audio.
fn recorded(model: &Arc<Model>, config: &SessionConfig, samples: &[f32]) -> Vec<Vec<Vec<u8>>> {
    let engine = engine(model);
    let sender = engine.session(&sending(config, false)).unwrap();
    let piece = samples.chunks_exact(model.config().audio.sample_rate / PICTURES);
    let packets = piece.map(|piece| {
        sender.push_audio(piece).unwrap();
        compute(&engine);
        packets(&sender)
    });
    packets.collect()
}

/// Every picture that a viewer sees of an avatar, shown `behind` seconds after its motion is due.
fn watch(model: &Arc<Model>, config: &SessionConfig, sent: &[Vec<Vec<u8>>], network: Network, behind: f64) -> Watched {
    let decoder = Session::decoder(model, config).unwrap();
    let mut dice = Dice(network.seed);
    let mut under_way: Vec<(f64, Vec<u8>)> = Vec::new();
    let latency = config.avatar.latency_frames(model.config()) as f64 / 30.0;
    let mut pictures = Vec::new();
    for (picture, packets) in sent.iter().enumerate() {
        let now = picture as f64 / PICTURES as f64;
        for packet in packets {
            let is_lost = now < network.until && dice.roll() < network.loss;
            for _ in 0..if dice.roll() < network.doubled { 2 } else { 1 } {
                let at = now + dice.roll() * network.delay;
                if !is_lost {
                    under_way.push((at, packet.clone()));
                }
            }
        }
        under_way.sort_by(|a, b| a.0.total_cmp(&b.0));
        let here = under_way.iter().take_while(|(at, _)| *at <= now).count();
        for (_, packet) in under_way.drain(..here) {
            decoder.push_packet(&packet).unwrap();
        }
        decoder.set_clock(now).unwrap();
        let mut shown = None;
        let sampled = decoder.sample_pose((now - latency - behind).max(0.0), |frame| shown = Some(Shown::new(frame)));
        pictures.push((shown.unwrap(), sampled.unwrap().is_ahead));
    }
    let received = decoder.received().unwrap();
    Watched { pictures, lost: received.lost, held: received.held, late: received.late }
}

struct Watched {
    /// Each picture, and whether its time was ahead of the frames.
    pictures: Vec<(Shown, bool)>,
    lost: u64,
    held: u64,
    late: u64,
}

impl Watched {
    /// The largest rotation of a joint and movement of the root between pictures.
    fn jump(&self) -> (f32, f32) {
        let pairs = self.pictures.windows(2);
        pairs.fold((0.0, 0.0), |(angle, way), pair| {
            let ((a, _), (b, _)) = (&pair[0], &pair[1]);
            (angle.max(a.angle(b)), way.max(a.way(b)))
        })
    }
}

/// Largest rotation of a joint between pictures, at 60 per second, in degrees, that does not count as a
/// jump: twice that of the undisturbed stream's fastest gesture, plus one degree.
fn allowed(undisturbed: f32) -> f32 {
    2.0 * undisturbed + 1.0
}

#[test]
fn over_a_bad_network_nothing_jumps() {
    let model = open(PEOPLE);
    let good = Network { loss: 0.0, doubled: 0.0, delay: 0.0, until: f64::MAX, seed: 1 };
    let sent = recorded(&model, &settings(&model, LayerGains::OFF), &speech());
    for (gains, reorder_window) in [(LayerGains::OFF, 0), (LayerGains::ON, 1)] {
        let config = SessionConfig { reorder_window, ..settings(&model, gains) };
        let (angle, way) = watch(&model, &config, &sent, good, 0.2).jump();
        for (loss, doubled, delay, behind) in
            [(0.1, 0.1, 0.1, 0.2), (0.2, 0.0, 0.6, 0.3), (0.3, 0.2, 0.9, 0.1), (0.3, 0.0, 0.0, 0.0)]
        {
            for seed in 1..4 {
                let network = Network { loss, doubled, delay, until: f64::MAX, seed };
                let seen = watch(&model, &config, &sent, network, behind);
                let jump = seen.jump();
                let ahead = seen.pictures.iter().filter(|(_, is_ahead)| *is_ahead).count();
                println!("{network:?} {behind}: {jump:?} of {angle} {way}, {ahead} ahead, {} {}", seen.lost, seen.late);
                assert!(jump.0 <= allowed(angle), "{network:?}: {} degrees, undisturbed {angle}", jump.0);
                assert!(jump.1 <= 2.0 * way + 0.01, "{network:?}: {} m, undisturbed {way}", jump.1);
            }
        }
    }
}

/// What a lost packet said of the mouth is not said again: its frames have the mouth of their codes, and the way there
/// and back takes no more than four frames each.
#[test]
fn a_lost_mouth_is_that_of_the_codes() {
    let model = open(PEOPLE);
    let config = settings(&model, LayerGains::OFF);
    let sent = recorded(&model, &config, &speech()[..16_000 * 5]);
    let all = |skipped: Option<usize>| {
        let decoder = Session::decoder(&model, &config).unwrap();
        let mut frames = Vec::new();
        for (_, packet) in sent.iter().flatten().enumerate().filter(|(at, _)| Some(*at) != skipped) {
            decoder.push_packet(packet).unwrap();
            frames.extend(pull(&decoder));
        }
        frames
    };
    let (wanted, seen) = (all(None), all(Some(4)));
    assert_eq!(wanted.len(), seen.len());
    let channels = model.mouth().unwrap().channels();
    let is_mouth = |at: usize| channels.contains(&at);
    let differs: Vec<usize> = (0..wanted.len()).filter(|&at| wanted[at].face != seen[at].face).collect();
    let (first, last) = (differs[0], differs[differs.len() - 1]);
    // The fifth chunk's frames, less those held back.
    let (chunk, held) = (config.avatar.target * model.config().keyframe_stride, config.avatar.held_back());
    let begins = 4 * chunk + 1 - model.config().keyframe_stride - held;
    assert!((begins..begins + 3).contains(&first), "{first}, not {begins}");
    assert!((begins + chunk - 3..begins + chunk + 4).contains(&last), "{last}, not {}", begins + chunk);
    for (wanted, seen) in wanted.iter().zip(&seen) {
        let others = |frame: &Shown| -> Vec<f32> {
            frame.face.iter().enumerate().filter(|(at, _)| !is_mouth(*at)).map(|(_, &value)| value).collect()
        };
        assert_eq!(others(wanted), others(seen), "frame {}", wanted.index);
    }
    let step = |frames: &[Shown]| {
        let jaw = model.config().face.names.iter().position(|name| name == "jawOpen").unwrap();
        frames.windows(2).map(|two| (two[1].face[jaw] - two[0].face[jaw]).abs()).fold(0.0, f32::max)
    };
    let jumps = [step(&wanted), step(&seen)];
    assert!(jumps[1] <= jumps[0] + 0.15, "{jumps:?}");
}

#[test]
fn after_a_loss_a_chunk_leads_back() {
    let model = open(PEOPLE);
    let config = settings(&model, LayerGains::OFF);
    let sent = recorded(&model, &config, &speech());
    let chunk = (config.avatar.target * model.config().keyframe_stride) as f64 / 30.0;
    let good = Network { loss: 0.0, doubled: 0.0, delay: 0.0, until: 0.0, seed: 1 };
    let wanted = watch(&model, &config, &sent, good, 0.1);
    for loss in [0.1, 0.2, 0.3, 1.0] {
        for seed in 1..4 {
            // With total loss the viewer waits for nearly three seconds.
            let until = if loss < 1.0 { 6.0 } else { 3.0 };
            let network = Network { loss, until, seed, ..good };
            let seen = watch(&model, &config, &sent, network, 0.1);
            // The first packet after the loss comes within a chunk, and its frames are shown within the
            // latency; the stream then has a chunk's time to recover.
            let latency = config.avatar.latency_frames(model.config()) as f64 / 30.0 + 0.1;
            #[expect(clippy::cast_possible_truncation, reason = "a stream of some seconds")]
            let healed = ((until + chunk + latency + chunk) * PICTURES as f64) as usize;
            let apart = |at: usize| wanted.pictures[at].0.angle(&seen.pictures[at].0);
            let off = (healed..wanted.pictures.len()).map(apart).fold(0.0, f32::max);
            let before = (0..healed).map(apart).fold(0.0, f32::max);
            let place = |at: usize| wanted.pictures[at].0.way(&seen.pictures[at].0);
            let way = (healed..wanted.pictures.len()).map(place).fold(0.0, f32::max);
            println!("{loss} {seed}: {before} degrees, then {off}; {way} m; {} lost, {} held", seen.lost, seen.held);
            assert!(off == 0.0 && way <= 0.0001, "{network:?}: {off} degrees and {way} m after {before}");
        }
    }
}

//! Packets are parsed by the format's description, and compared with bytes that PyPI's
//! `pylivelinkface` 0.1 decodes (`packet.hex`).

use clap::Parser as _;

use super::*;

fn args(extra: &[&str]) -> Live {
    let words = ["umo", "live", "--livelink", "127.0.0.1:11111"].iter().chain(extra);
    match crate::args::Args::try_parse_from(words).expect("arguments").command {
        crate::args::Command::Live(args) => args,
        _ => unreachable!("live was asked for"),
    }
}

fn sender(extra: &[&str]) -> Sender {
    Sender::new(crate::model::open(None).expect("the default model").config(), &args(extra)).expect("a sender")
}

/// A packet's fields.
struct Read {
    device: String,
    subject: String,
    frame: u32,
    part: f32,
    rate: [u32; 2],
    values: Vec<f32>,
}

fn read(packet: &[u8]) -> Read {
    let mut rest = packet;
    let mut take = |count: usize| rest.split_off(..count).expect("so many bytes");
    let number = |bytes: &[u8]| u32::from_be_bytes(bytes.try_into().expect("4 bytes"));
    assert_eq!(take(1), [6]);
    let mut text = || {
        let length = number(take(4)) as usize;
        String::from_utf8(take(length).to_vec()).expect("text")
    };
    let (device, subject) = (text(), text());
    let [frame, part, numerator, denominator] = std::array::from_fn(|_| number(take(4)));
    let count = usize::from(take(1)[0]);
    let values = (0..count).map(|_| f32::from_bits(number(take(4)))).collect();
    assert!(rest.is_empty());
    Read { device, subject, frame, part: f32::from_bits(part), rate: [numerator, denominator], values }
}

/// Returns a pose looking left and down, and a face with a distinct weight for every blendshape.
fn pose() -> (Pose, Vec<f32>) {
    let mut pose = Pose::REST;
    let (half, quarter) = (0.1_f32, 0.05_f32);
    // The neck about Y; the head and the left eye about X.
    pose.rotations[12] = [0.0, half.sin(), 0.0, half.cos()];
    pose.rotations[15] = [quarter.sin(), 0.0, 0.0, quarter.cos()];
    pose.rotations[23] = [half.sin(), 0.0, 0.0, half.cos()];
    (pose, (1..=52_u8).map(|i| f32::from(i) / 64.0).collect())
}

#[test]
fn a_face_is_sent_as_the_app_sends_it() {
    let (pose, face) = pose();
    let packet = sender(&[]).packet(&pose, &face, 2.51);
    let read = read(&packet);
    assert_eq!((read.device.len(), &*read.subject), (36, "umo"));
    assert_eq!((read.frame, read.rate), (150, [60, 1]));
    assert!((read.part - 0.6).abs() < 1e-4, "{}", read.part);
    // The default model's channels are in ARKit's order.
    assert_eq!(read.values[..52], face);
    let angles = [0.2, 0.1, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0];
    let differences = read.values[52..].iter().zip(angles).map(|(got, wanted)| (got - wanted).abs());
    assert!(read.values.len() == 61 && differences.fold(0.0, f32::max) < 1e-6, "{:?}", &read.values[52..]);
    let golden: String = include_str!("packet.hex").split_whitespace().collect();
    let hex: String = packet.iter().map(|byte| format!("{byte:02x}")).collect();
    // Except the angles, whose last bits depend on the system's math library.
    let same = hex.len() - 2 * 4 * angles.len();
    assert_eq!((hex.len(), &hex[..same]), (golden.len(), &golden[..same]));
}

#[test]
fn the_mouth_s_closing_can_be_left_to_the_jaw() {
    let mut face = vec![0.0; 52];
    (face[17], face[18]) = (0.5, 0.3);
    let shapes = read(&sender(&["--no-mouth-close"]).packet(&Pose::REST, &face, 0.0)).values;
    assert!((shapes[17] - 0.2).abs() < 1e-6 && shapes[18] == 0.0);
    (face[17], face[18]) = (0.1, 0.3);
    let shapes = read(&sender(&["--no-mouth-close"]).packet(&Pose::REST, &face, 0.0)).values;
    assert_eq!(shapes[17..19], [0.0, 0.0]);
    let shapes = read(&sender(&[]).packet(&Pose::REST, &face, 0.0)).values;
    assert_eq!(shapes[17..19], [0.1, 0.3]);
}

#[test]
fn subjects_have_devices_of_their_own() {
    let packet = |name| read(&sender(&["--subject", name]).packet(&Pose::REST, &[0.0; 52], 0.0));
    let (first, second) = (packet("Ada"), packet("Bo 2"));
    assert_eq!((&*first.subject, &*second.subject), ("Ada", "Bo 2"));
    assert_ne!(first.device, second.device);
    assert_eq!(first.device, packet("Ada").device);
}

#[test]
fn what_cannot_be_sent_is_refused() {
    let config = crate::model::open(None).expect("the default model").config().clone();
    for name in ["", "Zoë", "a\nb"] {
        let Err(Failure::Input(said)) = Sender::new(&config, &args(&["--subject", name])) else { panic!("{name}") };
        assert!(said.contains("--subject"), "{said}");
    }
    let mut smplx = config;
    smplx.face.kind = umo_core::FaceKind::SmplxExpression;
    let Err(Failure::Input(said)) = Sender::new(&smplx, &args(&[])) else { panic!("another face") };
    assert!(said.contains("Live Link Face needs an ARKit face"), "{said}");
}

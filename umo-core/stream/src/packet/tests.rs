use proptest::prelude::*;

use super::*;

fn layout(limits: &[u16]) -> PacketLayout {
    PacketLayout::of(limits.into(), 10, 0xABCD)
}

const PLAIN: PacketHead = PacketHead {
    is_prompted: false,
    stream: 3,
    sequence: 0x0102_0304,
    sample: 48_000,
    root: [1.5, -2.0],
    keyframes: 1,
    history: 1,
    total: None,
    mouth_frames: 0,
    mouth_back: 0,
};

/// Channels of a mouth, and frames of it in a packet, at most.
const LIPS: (usize, usize) = (3, 40);

#[test]
fn the_bits_are_those_of_the_specification() {
    let layout = layout(&[256, 5, 1, 2]);
    let mut bytes = [0; 64];
    let len = layout.encode(&PLAIN, &[[0xEE, 0x7F]], &[0x81, 4, 0, 1, 0xFF, 3, 0, 0], &[], &mut bytes).unwrap();
    let head = [
        &[0x02, 3, 0xCD, 0xAB, 4, 3, 2, 1, 0x80, 0xBB, 0, 0, 0, 0, 0, 0][..],
        &1.5_f32.to_le_bytes(),
        &(-2.0_f32).to_le_bytes(),
        &[1, 1],
        // Audio level and arousal of the new keyframe.
        &[0xEE, 0x7F],
    ];
    // 8 bits of 0x81, 3 bits of 4, 0 bits, 1 bit of 1; 8 of 0xFF, 3 of 3, 0, 1 of 0: lowest first.
    let packed = 0x81_u32 | 4 << 8 | 1 << 11 | 0xFF << 12 | 3 << 20;
    assert_eq!(bytes[..len], [&head.concat()[..], &packed.to_le_bytes()[..3]].concat());
    let last = PacketHead { keyframes: 0, history: 0, total: Some(7), ..PLAIN };
    let len = layout.encode(&last, &[], &[], &[], &mut bytes).unwrap();
    assert_eq!((bytes[0], &bytes[26..len]), (0x12, &[7, 0, 0, 0][..]));
}

#[test]
fn what_is_no_packet_is_refused() {
    let layout = layout(&[200, 5, 7]);
    let (mut bytes, mut sounds, mut codes) = ([0; 64], [[0; SOUND]; 10], [0; 30]);
    let len = layout.encode(&PLAIN, &[[9, 127]], &[199, 4, 6, 0, 1, 2], &[], &mut bytes).unwrap();
    let good = &bytes[..len];
    assert!(layout.decode(good, &mut sounds, &mut codes, &mut []).is_ok());
    for cut in 0..len {
        assert!(layout.decode(&good[..cut], &mut sounds, &mut codes, &mut []).is_err(), "{cut} bytes");
    }
    assert!(layout.decode(&[good, &[0]].concat(), &mut sounds, &mut codes, &mut []).is_err());
    let mut refused = |at: usize, value: u8, wanted: PacketError| {
        let mut bad = good.to_vec();
        bad[at] = value;
        assert_eq!(layout.decode(&bad, &mut sounds, &mut codes, &mut []), Err(wanted), "byte {at}");
    };
    refused(0, 1, PacketError::Malformed("its version is not 2 or 3: use the same version of umo on both sides"));
    refused(0, 3, PacketError::Malformed("it has the mouth of no frame, or of more than a chunk has"));
    refused(0, 0x42, PacketError::Malformed("it has flags that its version does not have"));
    refused(2, 0, PacketError::Other("model"));
    refused(19, 0x7F, PacketError::Malformed("its root is out of range"));
    refused(24, 200, PacketError::Malformed("it has more keyframes than the model's history"));
    refused(24, 2, PacketError::Malformed("its length is not that of its keyframes"));
    refused(28, 0xFF, PacketError::Malformed("a code is out of range"));
    refused(len - 1, good[len - 1] | 0x80, PacketError::Malformed("bits after the codes are not 0"));
}

#[test]
fn what_no_packet_can_say_is_an_error() {
    let layout = layout(&[200, 5]);
    let mut bytes = [0; 64];
    let head = PacketHead { keyframes: 2, history: 0, ..PLAIN };
    assert!(matches!(layout.encode(&head, &[[0; SOUND]; 2], &[0; 3], &[], &mut bytes), Err(StepError::Disagree(_))));
    assert!(matches!(layout.encode(&head, &[[0; SOUND]; 1], &[0; 4], &[], &mut bytes), Err(StepError::Disagree(_))));
    assert!(matches!(
        layout.encode(&head, &[[0; SOUND]; 2], &[0, 0, 0, 5], &[], &mut bytes),
        Err(StepError::OutOfRange { got: 5, .. })
    ));
    assert!(matches!(
        layout.encode(&head, &[[0; SOUND]; 2], &[0; 4], &[], &mut bytes[..30]),
        Err(StepError::TooLong { got: 33, .. })
    ));
    let many = PacketHead { keyframes: 6, history: 5, ..PLAIN };
    assert!(matches!(
        layout.encode(&many, &[[0; SOUND]; 6], &[0; 22], &[], &mut bytes),
        Err(StepError::TooLong { got: 11, limit: 10, .. })
    ));
}

/// A mouth of two frames after a packet of a keyframe: frames, coding, frames before the keyframe, then the first frame,
/// and the differences 1, -1 and 0 as 2, 1 and 0, with their lowest bit as it is.
#[test]
fn a_mouth_has_the_bits_of_the_specification() {
    let layout = layout(&[256]).with_mouth(LIPS.0, LIPS.1);
    let head = PacketHead { history: 0, mouth_frames: 2, mouth_back: 9, ..PLAIN };
    let (mut bytes, mouth) = ([0; 64], [10, 20, 30, 11, 19, 30]);
    let len = layout.encode(&head, &[[1, 2]], &[0x81], &mouth, &mut bytes).unwrap();
    assert_eq!((bytes[0], &bytes[26..30]), (0x03, &[2, 0, 9, 0][..]));
    // 1, 1, 0; 1, 0; 0.
    assert_eq!(bytes[30..len], [1, 2, 0x81, 10, 20, 30, 0b00_1011]);
    let (mut sounds, mut codes, mut found) = ([[0; SOUND]; 10], [0; 10], [0; 120]);
    assert_eq!(layout.decode(&bytes[..len], &mut sounds, &mut codes, &mut found), Ok(head));
    assert_eq!(found[..6], mouth);
    let refused = Err(PacketError::Malformed("its mouth is not that of its frames"));
    for (at, value) in [(26, 3), (27, 5), (27, 9), (len - 1, 0b100_1011), (len - 1, 0xFF)] {
        let mut bad = bytes;
        bad[at] = value;
        assert_eq!(layout.decode(&bad[..len], &mut sounds, &mut codes, &mut found), refused, "byte {at}");
    }
    let most = PacketHead { mouth_frames: LIPS.1 + 1, ..head };
    let refused = layout.encode(&most, &[[1, 2]], &[0x81], &[0; 123], &mut [0; 512]);
    assert!(matches!(refused, Err(StepError::TooLong { got: 41, limit: 40, .. })));
    assert!(matches!(layout.encode(&head, &[[1, 2]], &[0x81], &[0; 5], &mut bytes), Err(StepError::Disagree(_))));
}

/// A level's round trip has an error of at most half a step, 0.2 dB.
#[test]
fn levels_are_kept_within_a_step() {
    assert_eq!((level_byte(0.0), byte_level(0)), (0, 0.0));
    assert_eq!((level_byte(1.0), level_byte(40.0), level_byte(f32::NAN)), (255, 255, 0));
    for step in 0..1000 {
        let level = 10.0_f32.powf(-5.0 * step as f32 / 1000.0);
        let off = 20.0 * (byte_level(level_byte(level)) / level).log10();
        assert!(off.abs() <= 0.201, "{level}: {off} dB");
    }
    assert!((0..=255).all(|byte| level_byte(byte_level(byte)) == byte));
}

/// An arousal's round trip has an error of at most half a step; an ordinary one has none.
#[test]
fn arousal_is_kept_within_a_step() {
    assert_eq!([0.0, 0.5, 1.0].map(|arousal| byte_arousal(arousal_byte(arousal))), [0.0, 0.5, 1.0]);
    assert_eq!((arousal_byte(f32::NAN), byte_arousal(255)), (0, 1.0));
    assert!((0..=254).all(|byte| arousal_byte(byte_arousal(byte)) == byte));
}

fn case() -> impl Strategy<Value = (Vec<u16>, PacketHead, Vec<[u8; SOUND]>, Vec<u16>)> {
    let limits = prop::collection::vec(prop_oneof![1..=256_u16, Just(1), Just(65_535)], 1..12);
    let counts = (0..=5_usize, 0..=5_usize);
    (
        limits,
        counts,
        (any::<u8>(), 0..u32::MAX, any::<u64>()),
        prop::array::uniform2(-50.0..50.0_f32),
        any::<Option<u32>>(),
    )
        .prop_flat_map(|(limits, (keyframes, history), (stream, sequence, sample), root, total)| {
            let total = if keyframes == 0 { Some(total.unwrap_or(9)) } else { total };
            let head = PacketHead {
                stream,
                sequence,
                sample,
                root,
                keyframes,
                history,
                total,
                is_prompted: sequence % 3 == 0,
                mouth_frames: 0,
                mouth_back: 0,
            };
            let codes = limits.iter().cycle().take(limits.len() * (keyframes + history)).map(|&limit| 0..limit);
            (
                Just(limits.clone()),
                Just(head),
                prop::collection::vec(any::<[u8; SOUND]>(), keyframes),
                codes.collect::<Vec<_>>(),
            )
        })
}

/// A mouth that moves by at most `steps` a frame; any for 255.
fn mouth() -> impl Strategy<Value = Vec<u8>> {
    (0..=LIPS.1, prop_oneof![Just(0_u8), Just(3), Just(40), Just(255)]).prop_flat_map(|(frames, steps)| {
        prop::collection::vec(0..=steps, frames * LIPS.0).prop_map(|moves| {
            let mut mouth: Vec<u8> = Vec::new();
            for (i, by) in moves.into_iter().enumerate() {
                let before = i.checked_sub(LIPS.0).map_or(100, |at| mouth[at]);
                mouth.push(before.wrapping_add(by).wrapping_sub(by / 2).wrapping_sub(by / 4));
            }
            mouth
        })
    })
}

proptest! {
    #[test]
    fn packets_say_what_was_put_in((limits, head, sounds, codes) in case(), mouth in mouth(), back in any::<u16>()) {
        let layout = layout(&limits).with_mouth(LIPS.0, LIPS.1);
        let mouth_frames = mouth.len() / LIPS.0;
        let head = PacketHead { mouth_frames, mouth_back: if mouth_frames > 0 { back } else { 0 }, ..head };
        let (mut bytes, mut heard, mut found) = (vec![0xFF; 4096], [[3; SOUND]; 10], vec![9; 10 * limits.len()]);
        let mut said = vec![7; LIPS.0 * LIPS.1];
        let len = layout.encode(&head, &sounds, &codes, &mouth, &mut bytes).unwrap();
        let plain = layout.bytes(head.keyframes, head.history, head.total.is_some());
        prop_assert!((plain..=plain + MOUTH + mouth.len()).contains(&len));
        prop_assert!(len <= layout.most_bytes());
        prop_assert_eq!(layout.decode(&bytes[..len], &mut heard, &mut found, &mut said).unwrap(), head);
        prop_assert_eq!(&heard[..sounds.len()], &sounds[..]);
        prop_assert_eq!(&found[..codes.len()], &codes[..]);
        prop_assert_eq!(&said[..mouth.len()], &mouth[..]);
    }

    #[test]
    fn any_bytes_are_refused_or_a_packet(mut bytes in prop::collection::vec(any::<u8>(), 0..80), good in any::<bool>()) {
        let layout = layout(&[256, 5, 1, 2]).with_mouth(LIPS.0, LIPS.1);
        if good && bytes.len() > 27 {
            let version = 2 + (bytes[0] & 1);
            bytes[..4].copy_from_slice(&[version, 0, 0xCD, 0xAB]);
            bytes[24] %= 4;
            bytes[25] %= 4;
            bytes[26] %= 4;
            bytes[27] %= 10;
        }
        let room = || ([[0; SOUND]; 10], [0; 40], [0; LIPS.0 * LIPS.1]);
        let ((mut sounds, mut codes, mut mouth), mut again) = (room(), [0; 512]);
        if let Ok(head) = layout.decode(&bytes, &mut sounds, &mut codes, &mut mouth) {
            let (count, lips) = (4 * (head.keyframes + head.history), LIPS.0 * head.mouth_frames);
            let len =
                layout.encode(&head, &sounds[..head.keyframes], &codes[..count], &mouth[..lips], &mut again).unwrap();
            // A mouth may have been written longer than it need be.
            prop_assert!(len <= bytes.len() && (lips > 0 || again[..len] == bytes[..]));
            let (mut sounds_again, mut codes_again, mut mouth_again) = room();
            let read = layout.decode(&again[..len], &mut sounds_again, &mut codes_again, &mut mouth_again);
            prop_assert_eq!(read, Ok(head));
            prop_assert_eq!((sounds, codes, &mouth[..lips]), (sounds_again, codes_again, &mouth_again[..lips]));
        }
    }
}

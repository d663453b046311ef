//! A test signal between a voice and a siren, made of additions and multiplications only: its bits are the same on
//! every system.

/// Returns `seconds` of the signal, within -1..1.
pub fn samples(rate: usize, seconds: f32) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of samples")]
    let count = (rate as f32 * seconds) as usize;
    let sample = |i: usize| {
        let t = i as f32 / rate as f32;
        let envelope = (0.5 - 0.5 * wave(3.1 * t + 0.25)) * (0.5 + 0.5 * wave(0.23 * t));
        let pitch = 130.0 * t + 4.0 * wave(0.7 * t);
        (1..12_u8).map(|k| wave(pitch * f32::from(k)) / f32::from(k)).sum::<f32>() * envelope * 0.2
    };
    (0..count).map(sample).collect()
}

/// Approximates the sine of `turns` full turns by a parabola per half turn.
fn wave(turns: f32) -> f32 {
    let part = turns - turns.floor();
    if part < 0.5 { 16.0 * part * (0.5 - part) } else { 16.0 * (part - 0.5) * (part - 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bits do not depend on processor or system.
    #[test]
    fn the_voice_has_the_recorded_bits() {
        let samples = samples(16_000, 2.5);
        assert_eq!(samples.len(), 40_000);
        assert!(samples.iter().all(|sample| sample.abs() < 1.0) && samples.iter().any(|sample| sample.abs() > 0.3));
        let digest = samples.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, sample| {
            (hash ^ u64::from(sample.to_bits())).wrapping_mul(0x100_0000_01b3)
        });
        assert_eq!(digest, 0xc02b_56c3_0b99_9250, "{digest:#x}");
    }
}

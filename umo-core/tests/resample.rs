//! Resampling against exact sine waves.

use std::f64::consts::TAU;

use umo_core::{Resampler, StepError};
use umo_core_base::samples::mix;

const OUT: usize = 16_000;
const RATES: [usize; 15] = [
    1_000, 8_000, 11_025, 12_000, 15_999, 22_050, 24_000, 44_100, 48_000, 48_001, 96_000, 192_000, 384_000, 767_999,
    768_000,
];

#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
fn sine(rate: usize, samples: usize, frequency: f64) -> Vec<f32> {
    (0..samples).map(|i| (TAU * frequency * i as f64 / rate as f64 + 0.3).sin() as f32).collect()
}

fn resample(rate_in: usize, rate_out: usize, samples: &[f32]) -> Vec<f32> {
    let mut resampler = Resampler::new(rate_in, rate_out).unwrap();
    let mut out = Vec::new();
    resampler.push(samples, |piece| out.extend_from_slice(piece));
    resampler.finish(|piece| out.extend_from_slice(piece));
    out
}

/// The middle half, which the clip's ends do not affect.
fn middle(x: &[f32]) -> &[f32] {
    &x[x.len() / 4..x.len() * 3 / 4]
}

/// In the pass band the output must be the same sine, in phase.
#[test]
fn pass_band_is_kept_and_stays_in_time() {
    for rate in RATES {
        let mut worst = 0.0_f64;
        for share in [0.001, 0.33, 0.7, 0.9, 0.93] {
            let frequency = share * rate.min(OUT) as f64 / 2.0;
            let out = resample(rate, OUT, &sine(rate, rate, frequency));
            let wanted = sine(OUT, OUT, frequency);
            let pairs = middle(&out).iter().zip(middle(&wanted));
            let error = pairs.fold(0.0_f64, |a, (x, y)| a.max(f64::from((x - y).abs())));
            assert!(error < 3e-5, "{rate} Hz, {frequency} Hz: error {error}");
            worst = worst.max(error);
        }
        println!("{rate} Hz to {OUT} Hz: largest error {worst:.2e} up to 0.93 of the band");
    }
}

#[test]
fn what_the_lower_rate_cannot_hold_is_removed() {
    for rate in RATES.into_iter().filter(|&rate| rate > OUT) {
        let mut worst = 0.0_f64;
        for share in [1.001, 1.01, 1.03, 1.1, 1.33] {
            let frequency = share * OUT as f64 / 2.0;
            if frequency < 0.999 * rate as f64 / 2.0 {
                let out = resample(rate, OUT, &sine(rate, rate, frequency));
                worst = middle(&out).iter().fold(worst, |a, &v| a.max(f64::from(v.abs())));
            }
        }
        println!("{rate} Hz to {OUT} Hz: largest alias {:.1} dB", 20.0 * worst.log10());
        assert!(worst < 1e-5, "{rate} Hz: alias {worst}");
    }
}

#[test]
fn cuts_change_no_bit_and_the_length_is_exact() {
    for rate in [8_000, 15_999, OUT, 44_100, 48_001] {
        let samples = sine(rate, 20_011, 440.0);
        let mut resampler = Resampler::new(rate, OUT).unwrap();
        for length in [0, 1, 7, 480, 20_011] {
            let whole = resample(rate, OUT, &samples[..length]);
            assert_eq!(whole.len(), (2 * length * OUT + rate) / (2 * rate), "{rate} Hz, {length} samples");
            for step in [1, 13, 479, 4_096] {
                let mut cut = Vec::new();
                samples[..length]
                    .chunks(step)
                    .for_each(|piece| resampler.push(piece, |out| cut.extend_from_slice(out)));
                resampler.finish(|out| cut.extend_from_slice(out));
                assert!(cut == whole, "{rate} Hz, {length} samples in pieces of {step}");
            }
        }
    }
}

#[test]
fn equal_rates_change_nothing() {
    let samples = sine(OUT, 1_234, 3_000.0);
    assert_eq!(resample(OUT, OUT, &samples), samples);
}

#[test]
fn rates_out_of_range_are_refused() {
    for rate in [0, 999, 768_001, usize::MAX] {
        let wanted = StepError::OutOfRange { what: "sample rate", got: rate, limit: 768_001 };
        assert_eq!(Resampler::new(rate, OUT).err(), Some(wanted));
    }
}

#[test]
fn channels_are_averaged() {
    let mut out = [9.0; 3];
    mix(&[1.0, 3.0, -1.0, 0.5, 7.0], 2, &mut out);
    assert_eq!(out, [2.0, -0.25, 9.0]);
    mix(&[0.25], 1, &mut out);
    assert_eq!(out[0], 0.25);
    mix(&[f32::MAX; 8], 8, &mut out);
    assert_eq!(out[0], f32::MAX);
}

/// rubato's Fourier filter is 480 samples long and has the same pass band.
#[test]
fn rubato_resamples_alike() {
    use rubato::audioadapter_buffers::direct::SequentialSlice;
    use rubato::{Fft, FixedSync, Resampler as _, WindowFunction};
    for (rate_in, rate_out) in RATES.map(|rate| (rate, OUT)).into_iter().chain([(OUT, 8_000), (OUT, 44_100)]) {
        if rate_in == rate_out {
            continue;
        }
        let divisor = (1..=rate_in.min(rate_out)).rev().find(|d| rate_in % d == 0 && rate_out % d == 0).unwrap();
        let blocks = 480_usize.div_ceil((rate_in / divisor).min(rate_out / divisor)).next_multiple_of(2);
        let chunk = blocks * (rate_in / divisor);
        let window = WindowFunction::BlackmanHarris2;
        let mut theirs = Fft::<f64>::new_custom(rate_in, rate_out, chunk, 1, 1, window, FixedSync::Both).unwrap();
        let samples = sine(rate_in, 8 * chunk + chunk / 3, 0.31 * rate_in.min(rate_out) as f64);
        let mut out = Vec::new();
        for part in samples.chunks(chunk) {
            let mut block: Vec<f64> = part.iter().map(|&v| f64::from(v)).collect();
            block.resize(chunk, 0.0);
            let mut made = vec![0.0; theirs.output_frames_next()];
            let input = SequentialSlice::new(&block[..], 1, chunk).unwrap();
            let len = made.len();
            let mut output = SequentialSlice::new_mut(&mut made[..], 1, len).unwrap();
            theirs.process_into_buffer(&input, &mut output, None).unwrap();
            #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
            out.extend(made.iter().map(|&v| v as f32));
        }
        let ours = resample(rate_in, rate_out, &samples);
        let theirs_delay = theirs.output_delay();
        let theirs = &out[theirs_delay..];
        let len = ours.len().min(theirs.len());
        assert!(len > 7 * chunk * rate_out / rate_in, "{rate_in} Hz to {rate_out} Hz: {len} samples to compare");
        // The stream begins and ends within a wave, so the two filters differ there.
        let edge = theirs_delay + 480 * rate_out.div_ceil(rate_in.min(rate_out));
        let pairs = ours[edge..len - edge].iter().zip(&theirs[edge..len - edge]);
        let error = pairs.fold(0.0_f32, |most, (x, y)| most.max((x - y).abs()));
        println!("{rate_in} Hz to {rate_out} Hz: {error:.1e} from rubato");
        assert!(error < 2e-5, "{rate_in} Hz to {rate_out} Hz: {error}");
    }
}

/// An output is ready as soon as its input samples are there, half a filter after its time: 7 ms at
/// 16 kHz plus at most 8 samples.
#[test]
fn the_delay_is_half_a_filter() {
    for (rate_in, rate_out) in RATES.map(|rate| (rate, OUT)).into_iter().chain([(OUT, 8_000), (OUT, 44_100)]) {
        let mut resampler = Resampler::new(rate_in, rate_out).unwrap();
        let promised = resampler.most_delay();
        // Half the filter is 112 samples of the lower rate.
        let half = (112 * rate_in).div_ceil(rate_in.min(rate_out));
        assert!(promised <= half + 8, "{rate_in} Hz: {promised}");
        let (mut given, mut latest) = (0, 0.0_f64);
        for taken in 1..=rate_in.min(50_000) {
            let most = resampler.most_given(1);
            let before = given;
            resampler.push(&[0.5], |piece| given += piece.len());
            assert!(given - before <= most, "{rate_in} Hz: {} given, {most} expected", given - before);
            // The end time of the last output.
            if given > before {
                latest = latest.max(taken as f64 - (before + 1) as f64 * rate_in as f64 / rate_out as f64);
            }
        }
        println!("{rate_in} Hz to {rate_out} Hz: {latest} of {promised} samples");
        assert!(latest <= promised as f64 && latest > promised as f64 - 2.0, "{rate_in} Hz: {latest} of {promised}");
        let (mut left, most) = (0, resampler.most_left());
        resampler.finish(|piece| left += piece.len());
        assert!(left <= most, "{rate_in} Hz: {left} left of {most}");
    }
}

#[test]
fn a_constant_stays_the_same_constant() {
    for rate in RATES {
        let out = resample(rate, OUT, &vec![0.7; rate]);
        let error = middle(&out).iter().fold(0.0_f32, |most, value| most.max((value - 0.7).abs()));
        assert!(error < 1e-6, "{rate} Hz: {error}");
    }
}

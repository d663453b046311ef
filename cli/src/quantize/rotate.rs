//! Rotation of the residual streams and of attention's values, so that no channel is an outlier.
//!
//! The residual stream of a stack may be rotated by any orthogonal matrix: tables and matrices that write
//! to the stream apply the rotation, matrices that read it undo it, and an RMS norm without gain is
//! invariant. The gains are first folded into the matrices that read the norm's output. The values of a
//! head, which attention only sums, are rotated likewise. A Hadamard matrix with random signs spreads an
//! outlier channel, such as the marks of token positions, over all channels, which makes the int8 scales
//! smaller (Ashkboos et al. 2024, "QuaRot: Outlier-Free 4-Bit Inference in Rotated LLMs", section 4). The
//! function is unchanged, no data is needed, and inference costs nothing extra.

use umo_core::{Config, LoadError, ModelFile};

use crate::failure::Failure;

/// Seed of the language model's stream; its encoder and decoder share their tables.
const LM: u64 = 1;
/// Seed of the stream of layout `frames`' depth network.
const DEPTH: u64 = 2;
/// Seed of the values of each head.
const VALUES: u64 = 3;

/// Role of a tensor in the rotated streams.
#[derive(Debug, Default, PartialEq)]
struct Role {
    /// For a matrix that reads a stream after a norm: the stream and the norm's name.
    reads: Option<(u64, String)>,
    /// For a matrix whose outputs are added to a stream: the stream.
    writes: Option<u64>,
    /// For a table whose rows are added to a stream: the stream.
    table: Option<u64>,
    /// Whether this is a norm whose gain is folded into the matrices that read its output.
    norm: bool,
    /// For a matrix whose rows produce attention values: the number of heads.
    makes_values: Option<usize>,
    /// For a matrix whose columns consume attention values: the number of heads.
    takes_values: Option<usize>,
}

/// Refuses models that cannot be rotated.
pub(super) fn check(config: &Config) -> Result<(), Failure> {
    if !config.is_frames() && config.lm.tie_word_embeddings {
        return Err(Failure::input(
            "--rotate: the output head of this model is its table of tokens (`tie_word_embeddings`), which the gain \
             of the last norm cannot be folded into; quantize it without --rotate",
        ));
    }
    Ok(())
}

/// Rotates `values` of the tensor `name`.
pub(super) fn apply(file: &ModelFile, name: &str, shape: &[usize], values: &mut [f32]) -> Result<(), LoadError> {
    let role = role(file.config(), name);
    if role == Role::default() {
        return Ok(());
    }
    if role.norm {
        values.fill(1.0);
        return Ok(());
    }
    let (rows, columns) = (shape[0], shape[1]);
    let mut matrix: Vec<f64> = values.iter().copied().map(f64::from).collect();
    if let Some((stream, norm)) = &role.reads {
        let mut gain = vec![0.0_f32; columns];
        file.tensor(norm, &[columns])?.read(&mut gain)?;
        for row in matrix.chunks_exact_mut(columns) {
            row.iter_mut().zip(&gain).for_each(|(v, gain)| *v *= f64::from(*gain));
        }
        Rotation::new(columns, *stream).rows(&mut matrix);
    }
    if let Some(stream) = role.table {
        Rotation::new(columns, stream).rows(&mut matrix);
    }
    if let Some(heads) = role.takes_values {
        Rotation::new(columns / heads, VALUES).rows(&mut matrix);
    }
    if let Some(stream) = role.writes {
        Rotation::new(rows, stream).columns(&mut matrix, columns);
    }
    if let Some(heads) = role.makes_values {
        Rotation::new(rows / heads, VALUES).columns(&mut matrix, columns);
    }
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    values.iter_mut().zip(matrix).for_each(|(v, rotated)| *v = rotated as f32);
    Ok(())
}

fn role(config: &Config, name: &str) -> Role {
    let read = |stream, norm: String| Some((stream, norm));
    let mut role = Role::default();
    let stem = name.strip_suffix(".weight").unwrap_or(name);
    let last = stem.rsplit('.').next().unwrap_or_default();
    let (heads, decoded) = (config.lm.num_heads, "lm.decoder.final_layer_norm.weight");
    let encoded = "lm.encoder.final_layer_norm.weight";
    if stem == "lm.shared" || stem.starts_with("lm.frames.") {
        role.table = Some(LM);
    } else if stem == "lm.lm_head" {
        role.reads = read(LM, decoded.to_owned());
    } else if stem.starts_with("lm.") {
        role.norm = stem.ends_with("layer_norm");
        // `lm.STACK.block.I.layer.J` and the rest of the name.
        let layer: String = stem.splitn(7, '.').take(6).collect::<Vec<_>>().join(".");
        let own = format!("{layer}.layer_norm.weight");
        match last {
            "k" | "v" if stem.contains(".EncDecAttention.") => role.reads = read(LM, encoded.to_owned()),
            "q" | "k" | "v" | "router" | "wi_0" | "wi_1" => role.reads = read(LM, own),
            "o" | "wo" => role.writes = Some(LM),
            _ => {}
        }
        role.makes_values = (last == "v").then_some(heads);
        role.takes_values = (last == "o").then_some(heads);
    } else if let Some((depth, rest)) = config.depth.as_ref().zip(stem.strip_prefix("depth.")) {
        let first = rest.split('.').next().unwrap_or_default();
        match first {
            "input" | "heard" => {
                role.reads = read(LM, if first == "input" { decoded } else { encoded }.to_owned());
                role.writes = Some(DEPTH);
            }
            "position" | "embed" | "before" => role.table = Some(DEPTH),
            "head" => role.reads = read(DEPTH, "depth.norm.weight".to_owned()),
            _ => role.norm = last == "norm" || last.ends_with("_norm"),
        }
        // `depth.layers.I` and the rest of the name.
        let layer: String = stem.splitn(4, '.').take(3).collect::<Vec<_>>().join(".");
        if first == "layers" {
            match last {
                "q" | "k" | "v" => role.reads = read(DEPTH, format!("{layer}.attention_norm.weight")),
                "wi_0" | "wi_1" => role.reads = read(DEPTH, format!("{layer}.feed_forward_norm.weight")),
                "o" | "wo" => role.writes = Some(DEPTH),
                _ => {}
            }
            role.makes_values = (last == "v").then_some(depth.num_heads);
            role.takes_values = (last == "o").then_some(depth.num_heads);
        }
    }
    role
}

/// An orthogonal matrix: random signs, then a Hadamard matrix of the largest power of two that divides
/// the width, times a cosine transform over the remaining odd factor.
struct Rotation {
    signs: Vec<f64>,
    power: usize,
    cosines: Vec<f64>,
}

impl Rotation {
    /// Creates a rotation of `width` channels; `seed` determines the signs.
    fn new(width: usize, seed: u64) -> Self {
        let power = 1 << width.trailing_zeros();
        let odd = width / power;
        let mut state = seed;
        let mut signs = Vec::with_capacity(width);
        for _ in 0..width {
            signs.push(if splitmix(&mut state) >> 63 == 0 { 1.0 } else { -1.0 });
        }
        let size = odd as f64;
        let cosine = |k: usize, i: usize| {
            let scale = if k == 0 { 1.0 } else { 2.0_f64.sqrt() } / size.sqrt();
            scale * (std::f64::consts::PI * (i as f64 + 0.5) * k as f64 / size).cos()
        };
        let cosines = (0..odd * odd).map(|at| cosine(at / odd, at % odd)).collect();
        Self { signs, power, cosines }
    }

    /// Rotates each row of `width` values.
    fn rows(&self, matrix: &mut [f64]) {
        let mut mixed = vec![0.0; self.signs.len()];
        matrix.chunks_exact_mut(self.signs.len()).for_each(|row| self.vector(row, &mut mixed));
    }

    /// Rotates each run of `width` values in every column.
    fn columns(&self, matrix: &mut [f64], columns: usize) {
        let width = self.signs.len();
        let (mut column, mut mixed) = (vec![0.0; width], vec![0.0; width]);
        for block in matrix.chunks_exact_mut(width * columns) {
            for at in 0..columns {
                column.iter_mut().enumerate().for_each(|(row, v)| *v = block[row * columns + at]);
                self.vector(&mut column, &mut mixed);
                column.iter().enumerate().for_each(|(row, v)| block[row * columns + at] = *v);
            }
        }
    }

    fn vector(&self, values: &mut [f64], mixed: &mut [f64]) {
        values.iter_mut().zip(&self.signs).for_each(|(v, sign)| *v *= sign);
        for part in values.chunks_exact_mut(self.power) {
            let mut half = 1;
            while half < self.power {
                for pair in part.chunks_exact_mut(2 * half) {
                    let (low, high) = pair.split_at_mut(half);
                    for (a, b) in low.iter_mut().zip(high) {
                        (*a, *b) = (*a + *b, *a - *b);
                    }
                }
                half *= 2;
            }
            let scale = (self.power as f64).sqrt().recip();
            part.iter_mut().for_each(|v| *v *= scale);
        }
        let odd = values.len() / self.power;
        if odd == 1 {
            return;
        }
        mixed.fill(0.0);
        for (to, cosines) in mixed.chunks_exact_mut(self.power).zip(self.cosines.chunks_exact(odd)) {
            for (from, cosine) in values.chunks_exact(self.power).zip(cosines) {
                to.iter_mut().zip(from).for_each(|(to, from)| *to += cosine * from);
            }
        }
        values.copy_from_slice(mixed);
    }
}

/// Returns the next output of Vigna's SplitMix64.
fn splitmix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotation preserves lengths and angles, rows and columns are rotated alike, and one outlier becomes many
    /// values of equal size.
    #[test]
    fn a_rotation_is_orthogonal_and_spreads_one_channel() {
        for width in [1, 2, 3, 8, 12, 56, 192, 256] {
            let rotation = Rotation::new(width, 7);
            let mut unit: Vec<f64> =
                (0..width * width).map(|at| f64::from(u8::from(at / width == at % width))).collect();
            rotation.rows(&mut unit);
            for (a, one) in unit.chunks_exact(width).enumerate() {
                for (b, other) in unit.chunks_exact(width).enumerate() {
                    let product: f64 = one.iter().zip(other).map(|(a, b)| a * b).sum();
                    assert!((product - f64::from(u8::from(a == b))).abs() < 1e-12, "width {width}, rows {a}, {b}");
                }
            }
            let mut column: Vec<f64> = (0..width).map(|at| at as f64 - 1.5).collect();
            let mut row = column.clone();
            rotation.rows(&mut row);
            rotation.columns(&mut column, 1);
            assert_eq!(row, column);
        }
        let mut outlier = [0.0; 64];
        outlier[5] = 8.0;
        Rotation::new(64, 1).rows(&mut outlier);
        assert!(outlier.iter().all(|v| (v.abs() - 1.0).abs() < 1e-12), "{outlier:?}");
    }
}

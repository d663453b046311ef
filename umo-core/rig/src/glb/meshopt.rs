//! Decoders of `EXT_meshopt_compression`: vertex, triangle and index streams, and the vertex filters.
//!
//! The bitstream follows the extension's specification (version 0 for vertices, 0 and 1 for indices).

/// Upper bound on the bytes of a vertex block, which has at most [`BLOCK`] vertices.
const BLOCK_BYTES: usize = 8192;
const BLOCK: usize = 256;
/// Number of values in a group; they share a bit width.
const GROUP: usize = 16;
/// Minimum size in bytes of the tail of a vertex stream, which holds the first vertex, padded in front.
const VERTEX_TAIL: usize = 32;
/// Largest vertex, in bytes.
const MAX_VERTEX: usize = 256;

const CUT: &str = "its compressed data is cut short";
const LONG: &str = "its compressed data is longer than its values";

/// Reads bytes in sequence.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], &'static str> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(CUT)?;
        self.0 = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Result<u8, &'static str> {
        Ok(self.take(1)?[0])
    }

    /// Reads a variable-length number: 7 bits per byte, lowest first.
    fn number(&mut self) -> Result<u32, &'static str> {
        let mut value = 0;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u32::from(byte & 127).wrapping_shl(shift);
            if byte < 128 {
                return Ok(value);
            }
        }
        Err("a number of its compressed data is too long")
    }

    /// Reads a signed delta and adds it to `from`.
    fn stepped(&mut self, from: u32) -> Result<u32, &'static str> {
        Ok(from.wrapping_add(signed(self.number()?)))
    }

    fn end(&self) -> Result<(), &'static str> {
        if self.0.is_empty() { Ok(()) } else { Err(LONG) }
    }
}

/// Zigzag decoding: 0, -1, 1, -2, …
const fn signed(number: u32) -> u32 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

/// Checks the first byte and returns the stream's version.
fn version(reader: &mut Reader<'_>, kind: u8, newest: u8) -> Result<u8, String> {
    let first = reader.byte()?;
    match (first & 0xf0, first & 0x0f) {
        (found, version) if found == kind && version <= newest => Ok(version),
        (found, version) if found == kind => {
            Err(format!("its compressed data has version {version}, expected {newest}"))
        }
        _ => Err("its compressed data is not of its mode".to_owned()),
    }
}

/// Decodes vertices into `out`, whose length is a multiple of `size`, the bytes of a vertex.
///
/// # Errors
/// The stream violates the format.
pub(super) fn vertices(data: &[u8], size: usize, out: &mut [u8]) -> Result<(), String> {
    if size == 0 || size > MAX_VERTEX || !size.is_multiple_of(4) {
        return Err(format!("vertices of {size} bytes, expected a multiple of 4 up to {MAX_VERTEX}"));
    }
    let mut reader = Reader(data);
    version(&mut reader, 0xa0, 0)?;
    let tail = size.max(VERTEX_TAIL);
    let (blocks, tail) = reader.0.split_at_checked(reader.0.len().wrapping_sub(tail)).ok_or(CUT)?;
    let mut reader = Reader(blocks);
    let mut last = [0; MAX_VERTEX];
    last[..size].copy_from_slice(&tail[tail.len() - size..]);
    let block = (BLOCK_BYTES / size / GROUP * GROUP).min(BLOCK);
    for vertices in out.chunks_mut(block * size) {
        let count = vertices.len() / size;
        for (at, last) in last[..size].iter_mut().enumerate() {
            let mut values = [0; BLOCK];
            bytes(&mut reader, &mut values[..count.next_multiple_of(GROUP)])?;
            for (vertex, &value) in vertices.chunks_exact_mut(size).zip(&values) {
                *last = last.wrapping_add((value >> 1) ^ (value & 1).wrapping_neg());
                vertex[at] = *last;
            }
        }
    }
    Ok(reader.end()?)
}

/// Decodes one byte of each vertex. The bit widths of the groups come first, two bits each.
fn bytes(reader: &mut Reader<'_>, out: &mut [u8]) -> Result<(), &'static str> {
    let widths = reader.take((out.len() / GROUP).div_ceil(4))?;
    for (at, group) in out.chunks_exact_mut(GROUP).enumerate() {
        match (widths[at / 4] >> (at % 4 * 2)) & 3 {
            0 => {}
            3 => group.copy_from_slice(reader.take(GROUP)?),
            width => {
                let bits = 2 * width;
                let packed = reader.take(GROUP * usize::from(bits) / 8)?;
                // The largest value of a width is an escape: the value follows as a byte.
                let escape = (1 << bits) - 1;
                for (at, value) in group.iter_mut().enumerate() {
                    let bit = at * usize::from(bits);
                    let found = (packed[bit / 8] >> (8 - usize::from(bits) - bit % 8)) & escape;
                    *value = if found == escape { reader.byte()? } else { found };
                }
            }
        }
    }
    Ok(())
}

/// The last 16 entries.
struct Recent<T> {
    values: [T; 16],
    next: usize,
}

impl<T: Copy> Recent<T> {
    fn new(none: T) -> Self {
        Self { values: [none; 16], next: 0 }
    }

    fn push(&mut self, value: T) {
        self.values[self.next] = value;
        self.next = (self.next + 1) % 16;
    }

    /// Returns the entry `back` before the last.
    fn get(&self, back: u8) -> T {
        self.values[(self.next + 31 - usize::from(back)) % 16]
    }
}

/// Decodes triangles: `count` indices, three per triangle, each passed to `put`.
///
/// # Errors
/// The stream violates the format.
pub(super) fn triangles(data: &[u8], count: usize, put: &mut dyn FnMut(u32)) -> Result<(), String> {
    if !count.is_multiple_of(3) {
        return Err(format!("triangles of {count} indices"));
    }
    let mut reader = Reader(data);
    let version = version(&mut reader, 0xe0, 1)?;
    let codes = reader.take(count / 3)?;
    let (inside, table) = reader.0.split_last_chunk::<16>().ok_or(CUT)?;
    let mut state =
        Triangles { reader: Reader(inside), next: 0, last: 0, edges: Recent::new([0; 2]), corners: Recent::new(0) };
    let steps = if version == 0 { 15 } else { 13 };
    for &code in codes {
        let corners = match code {
            0..0xf0 => state.on_edge(code, steps)?,
            0xf0..0xfe => {
                let pair = table[usize::from(code & 15)];
                state.apart([0, pair >> 4, pair & 15], false)?
            }
            _ => {
                let pair = state.reader.byte()?;
                if pair == 0 {
                    state.next = 0;
                }
                state.apart([if code == 0xfe { 0 } else { 15 }, pair >> 4, pair & 15], true)?
            }
        };
        corners.into_iter().for_each(&mut *put);
    }
    Ok(state.reader.end()?)
}

/// Decoder state of a triangle stream.
struct Triangles<'a> {
    reader: Reader<'a>,
    /// The lowest index that has not occurred yet.
    next: u32,
    /// The last index that was coded explicitly.
    last: u32,
    edges: Recent<[u32; 2]>,
    corners: Recent<u32>,
}

impl Triangles<'_> {
    /// Returns the lowest index that has not occurred yet.
    fn new_corner(&mut self) -> u32 {
        let corner = self.next;
        self.next = self.next.wrapping_add(1);
        corner
    }

    /// Triangle on a recent edge: the code selects the edge and the third corner.
    fn on_edge(&mut self, code: u8, steps: u8) -> Result<[u32; 3], &'static str> {
        let [a, b] = self.edges.get(code >> 4);
        let back = code & 15;
        let c = match back {
            0 => self.new_corner(),
            back if back < steps => self.corners.get(back),
            13 => self.last.wrapping_sub(1),
            14 => self.last.wrapping_add(1),
            _ => self.reader.stepped(self.last)?,
        };
        if back >= steps {
            self.last = c;
        }
        if back == 0 || back >= steps {
            self.corners.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// Triangle of three corners: each is new (0), a recent one, or, if `written`, coded explicitly (15).
    fn apart(&mut self, kinds: [u8; 3], written: bool) -> Result<[u32; 3], &'static str> {
        // All are looked up before any is pushed.
        let mut corners = [0; 3];
        for (corner, kind) in corners.iter_mut().zip(kinds) {
            *corner = match kind {
                0 => self.new_corner(),
                15 if written => 0,
                back => self.corners.get(back - 1),
            };
        }
        for (corner, kind) in corners.iter_mut().zip(kinds) {
            if kind == 15 && written {
                self.last = self.reader.stepped(self.last)?;
                *corner = self.last;
            }
            if kind == 0 || kind == 15 && written {
                self.corners.push(*corner);
            }
        }
        let [a, b, c] = corners;
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| self.edges.push(edge));
        Ok(corners)
    }
}

/// Decodes `count` indices, each passed to `put`.
///
/// # Errors
/// The stream violates the format.
pub(super) fn indices(data: &[u8], count: usize, put: &mut dyn FnMut(u32)) -> Result<(), String> {
    let mut reader = Reader(data);
    version(&mut reader, 0xd0, 1)?;
    let (inside, _) = reader.0.split_last_chunk::<4>().ok_or(CUT)?;
    let mut reader = Reader(inside);
    let mut last = [0_u32; 2];
    for _ in 0..count {
        let number = reader.number()?;
        let last = &mut last[(number & 1) as usize];
        *last = last.wrapping_add(signed(number >> 1));
        put(*last);
    }
    Ok(reader.end()?)
}

/// Reverses a filter over vertices of `size` bytes.
///
/// # Errors
/// The filter is unknown, or does not support vertices of this size.
#[expect(clippy::cast_possible_truncation, reason = "numbers of the types that they are stored as")]
pub(super) fn unfilter(filter: &str, size: usize, values: &mut [u8]) -> Result<(), String> {
    let fits = match filter {
        "NONE" => return Ok(()),
        "OCTAHEDRAL" => size == 4 || size == 8,
        "QUATERNION" => size == 8,
        "EXPONENTIAL" => size.is_multiple_of(4),
        _ => return Err(format!("its filter {filter} is unknown")),
    };
    if !fits {
        return Err(format!("its filter {filter} does not go with {size} bytes"));
    }
    match (filter, size) {
        ("OCTAHEDRAL", 4) => values.as_chunks_mut().0.iter_mut().for_each(|value| {
            let turned = octahedral(value.map(|byte| f32::from(i8::from_le_bytes([byte]))), 127.0);
            value.iter_mut().zip(turned).for_each(|(byte, x)| [*byte] = (rounded(x) as i8).to_le_bytes());
        }),
        ("EXPONENTIAL", _) => values.as_chunks_mut().0.iter_mut().for_each(|value| {
            let word = i32::from_le_bytes(*value);
            *value = ((f64::from(word << 8 >> 8) * 2.0_f64.powi(word >> 24)) as f32).to_le_bytes();
        }),
        _ => values.as_chunks_mut::<8>().0.iter_mut().for_each(|value| {
            let shorts: [i16; 4] = std::array::from_fn(|i| i16::from_le_bytes([value[2 * i], value[2 * i + 1]]));
            let turned = match filter {
                "QUATERNION" => quaternion(shorts),
                _ => {
                    let [x, y, z] = octahedral(shorts.map(f32::from), 32767.0);
                    [x, y, z, f32::from(shorts[3])]
                }
            };
            let bytes = value.as_chunks_mut::<2>().0;
            bytes.iter_mut().zip(turned).for_each(|(bytes, x)| *bytes = (rounded(x) as i16).to_le_bytes());
        }),
    }
    Ok(())
}

/// Rounds to the nearest integer, halves away from 0, as the format specifies.
#[expect(clippy::cast_possible_truncation, reason = "at most 2^15")]
fn rounded(x: f32) -> i32 {
    (x + 0.5_f32.copysign(x)) as i32
}

/// Decodes an octahedral unit vector, scaled by `most`.
fn octahedral([x, y, one, _]: [f32; 4], most: f32) -> [f32; 3] {
    let z = one - x.abs() - y.abs();
    let below = z.min(0.0);
    let [x, y] = [x, y].map(|x| if x >= 0.0 { x + below } else { x - below });
    let scale = most / (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|v| v * scale)
}

/// Decodes a unit quaternion, scaled by 32767, from its three smaller components and the index of the largest.
fn quaternion([x, y, z, last]: [i16; 4]) -> [f32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / f32::from(last | 3);
    let parts = [x, y, z].map(|part| f32::from(part) * scale);
    let largest = (1.0 - parts.iter().map(|part| part * part).sum::<f32>()).max(0.0).sqrt();
    let mut turned = [0.0; 4];
    let at = usize::from(last.to_le_bytes()[0] & 3);
    turned[at] = largest * 32767.0;
    (1..).zip(parts).for_each(|(step, part)| turned[(at + step) % 4] = part * 32767.0);
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use data_encoding::BASE64;

    #[derive(serde::Deserialize)]
    struct Case {
        mode: String,
        count: usize,
        size: usize,
        filter: String,
        data: String,
        values: String,
    }

    fn decoded(case: &Case, data: &[u8]) -> Result<Vec<u8>, String> {
        let mut out = vec![0; case.count * case.size];
        let mut numbers = Vec::new();
        match case.mode.as_str() {
            "ATTRIBUTES" => {
                vertices(data, case.size, &mut out)?;
                unfilter(&case.filter, case.size, &mut out)?;
                return Ok(out);
            }
            "TRIANGLES" => triangles(data, case.count, &mut |index| numbers.push(index))?,
            _ => indices(data, case.count, &mut |index| numbers.push(index))?,
        }
        Ok(numbers.iter().flat_map(|index| index.to_le_bytes()[..case.size].to_vec()).collect())
    }

    /// Streams of the reference encoder, generated by `tests/glb/meshopt.mjs`.
    fn cases() -> Vec<(Case, Vec<u8>)> {
        let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/glb/meshopt.json"));
        let cases: Vec<Case> = serde_json::from_str(text).unwrap();
        let data = |case: Case| {
            let data = BASE64.decode(case.data.as_bytes()).unwrap();
            (case, data)
        };
        cases.into_iter().map(data).collect()
    }

    #[test]
    fn streams_of_the_reference_are_decoded_as_it_does() {
        for (at, (case, data)) in cases().iter().enumerate() {
            let wanted = BASE64.decode(case.values.as_bytes()).unwrap();
            let found = decoded(case, data).unwrap();
            // The reference rounds in its vector instructions.
            let least = usize::from(["OCTAHEDRAL", "QUATERNION"].contains(&case.filter.as_str()));
            let number = |bytes: &[u8]| match *bytes {
                [byte] => i32::from(i8::from_le_bytes([byte])),
                [low, high] => i32::from(i16::from_le_bytes([low, high])),
                _ => unreachable!("one or two bytes"),
            };
            let width = if case.size == 4 { 1 } else { 2 };
            let pairs = found.chunks(width).zip(wanted.chunks(width));
            let apart = pairs.map(|(a, b)| number(a).abs_diff(number(b)) as usize).max();
            assert!(
                found.len() == wanted.len() && apart <= Some(least),
                "case {at}: {apart:?}, {} {}",
                case.mode,
                case.filter
            );
        }
    }

    #[test]
    fn damaged_streams_are_refused_or_decoded_without_a_panic() {
        for (case, data) in cases() {
            for length in 0..data.len() {
                assert!(decoded(&case, &data[..length]).is_err(), "{} cut to {length}", case.mode);
            }
            for at in 0..data.len() {
                let mut spoilt = data.clone();
                spoilt[at] ^= 0x55;
                let _ = decoded(&case, &spoilt);
            }
            assert!(decoded(&case, &[&data[..], &[0]].concat()).is_err(), "{}", case.mode);
        }
        let unknown = unfilter("SEPIA", 4, &mut []).unwrap_err();
        assert!(unknown.contains("SEPIA"), "{unknown}");
        assert!(vertices(&[0xa1, 0, 0], 4, &mut [0; 4]).unwrap_err().contains("version 1"));
    }
}

//! The mouth in a packet: differences from frame to frame in Rice's code (SPEC 2.18).

/// Coding of bytes as they are.
const PLAIN: u8 = 8;

/// A byte's difference from the one before, small ones of either sign first: 0, -1, 1, -2, …
fn difference(value: u8, before: u8) -> u8 {
    let by = value.wrapping_sub(before).cast_signed();
    ((by << 1) ^ (by >> 7)).cast_unsigned()
}

/// The byte after `before` with this [`difference`].
fn after(before: u8, difference: u8) -> u8 {
    let by = (difference >> 1) ^ 0_u8.wrapping_sub(difference & 1);
    before.wrapping_add(by)
}

/// Differences of the frames after the first.
fn differences(mouth: &[u8], channels: usize) -> impl Iterator<Item = u8> {
    mouth.iter().skip(channels).zip(mouth).map(|(&value, &before)| difference(value, before))
}

/// The shortest coding of `[frames, channels]`, and its length, bytes: the number of low bits of a difference that are
/// written as they are, or [`PLAIN`].
pub(super) fn coding(mouth: &[u8], channels: usize) -> (u8, usize) {
    if mouth.is_empty() {
        return (0, 0);
    }
    let bits = |low: &u8| differences(mouth, channels).map(|by| usize::from(by >> low) + 1 + usize::from(*low)).sum();
    let bytes = |bits: usize| channels + bits.div_ceil(8);
    let best = (0..PLAIN).map(|low| (low, bytes(bits(&low)))).min_by_key(|&(_, bytes)| bytes);
    best.filter(|&(_, bytes)| bytes < mouth.len()).unwrap_or((PLAIN, mouth.len()))
}

/// Writes the mouth to `out`, which is zero and has the coding's length.
pub(super) fn write(mouth: &[u8], channels: usize, coding: u8, out: &mut [u8]) {
    if coding == PLAIN || mouth.is_empty() {
        return out.copy_from_slice(mouth);
    }
    let (first, out) = out.split_at_mut(channels);
    first.copy_from_slice(&mouth[..channels]);
    let mut at = 0;
    let mut put = |is_set: bool| {
        out[at / 8] |= u8::from(is_set) << (at % 8);
        at += 1;
    };
    for by in differences(mouth, channels) {
        (0..by >> coding).for_each(|_| put(true));
        put(false);
        (0..coding).for_each(|bit| put(by >> bit & 1 != 0));
    }
}

/// Reads the mouth `[frames, channels]`; `false` if the bytes are not one of that size.
pub(super) fn read(bytes: &[u8], channels: usize, coding: u8, mouth: &mut [u8]) -> bool {
    if mouth.is_empty() || coding == PLAIN {
        let fits = bytes.len() == mouth.len() && (coding == 0 || !mouth.is_empty());
        if fits {
            mouth.copy_from_slice(bytes);
        }
        return fits;
    }
    let Some((first, bytes)) = bytes.split_at_checked(channels).filter(|_| coding < PLAIN) else { return false };
    mouth[..channels].copy_from_slice(first);
    let mut at = 0;
    let mut next = || {
        let bit = bytes.get(at / 8).map(|byte| byte >> (at % 8) & 1 != 0);
        at += 1;
        bit
    };
    for i in channels..mouth.len() {
        let mut by = 0_usize;
        loop {
            match next() {
                Some(true) => by += 1,
                Some(false) => break,
                None => return false,
            }
        }
        by <<= coding;
        for bit in 0..coding {
            match next() {
                Some(is_set) => by |= usize::from(is_set) << bit,
                None => return false,
            }
        }
        let Ok(by) = u8::try_from(by) else { return false };
        mouth[i] = after(mouth[i - channels], by);
    }
    // What is left of the last byte is zero.
    at.div_ceil(8) == bytes.len() && (at..8 * bytes.len()).all(|at| bytes[at / 8] >> (at % 8) & 1 == 0)
}

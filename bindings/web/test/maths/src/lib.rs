//! `exp`, `sin` and similar functions as implemented for WebAssembly, under the C library's names. Loaded before the C
//! library (`LD_PRELOAD`), they replace its functions in a native program.

/// Defines C functions that call those of the other library: `name(arguments) -> type`.
macro_rules! functions {
    ($($name:ident($($x:ident),+) -> $float:ty;)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name($($x: $float),+) -> $float {
            libm::$name($($x),+)
        }
    )*};
}

functions! {
    acosf(x) -> f32;
    asinf(x) -> f32;
    atan2f(y, x) -> f32;
    atanf(x) -> f32;
    cbrtf(x) -> f32;
    cosf(x) -> f32;
    exp2f(x) -> f32;
    expf(x) -> f32;
    expm1f(x) -> f32;
    log10f(x) -> f32;
    log1pf(x) -> f32;
    log2f(x) -> f32;
    logf(x) -> f32;
    powf(x, y) -> f32;
    sinf(x) -> f32;
    tanf(x) -> f32;
    tanhf(x) -> f32;
    acos(x) -> f64;
    asin(x) -> f64;
    atan(x) -> f64;
    atan2(y, x) -> f64;
    cbrt(x) -> f64;
    cos(x) -> f64;
    exp(x) -> f64;
    exp2(x) -> f64;
    expm1(x) -> f64;
    log(x) -> f64;
    log10(x) -> f64;
    log1p(x) -> f64;
    log2(x) -> f64;
    pow(x, y) -> f64;
    sin(x) -> f64;
    tan(x) -> f64;
    tanh(x) -> f64;
}

/// # Safety
///
/// `sin` and `cos` are writable, as for the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sincosf(x: f32, sin: *mut f32, cos: *mut f32) {
    let (s, c) = libm::sincosf(x);
    // SAFETY: writable, as required above.
    unsafe { sin.write(s) };
    // SAFETY: likewise.
    unsafe { cos.write(c) };
}

/// # Safety
///
/// `sin` and `cos` are writable, as for the C library's function.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sincos(x: f64, sin: *mut f64, cos: *mut f64) {
    let (s, c) = libm::sincos(x);
    // SAFETY: writable, as required above.
    unsafe { sin.write(s) };
    // SAFETY: likewise.
    unsafe { cos.write(c) };
}

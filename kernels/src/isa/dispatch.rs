//! From an [`Isa`](super::Isa) to a function compiled for it: the only place that calls such
//! functions from code without its target features.

/// Calls a function of the module for the back-end of `$isa`, with the back-end's
/// token before the other arguments (the scalar module takes none).
///
/// The short form is for operations with the modules `scalar`, `avx2`, `avx512vnni`, `neon` and `simd128`:
/// the other back-ends have no better instructions for them. `with tiles` also uses a module `amx`.
/// The long form names a module for every back-end.
macro_rules! dispatch {
    (@call scalar $function:ident $token:ident ($($argument:expr),*)) => {{
        let _ = $token;
        scalar::$function($($argument),*)
    }};
    (@call $module:ident $function:ident $token:ident ($($argument:expr),*)) => {
        $module::$function($token.into(), $($argument),*)
    };
    (@short $isa:expr, $function:ident($($argument:expr),*), $amx:ident) => {
        $crate::isa::dispatch!($isa, $function($($argument),*), {
            Scalar: scalar,
            Avx2: avx2,
            AvxVnni: avx2,
            Avx512Vnni: avx512vnni,
            Avx512Bf16: avx512vnni,
            Amx: $amx,
            Neon: neon,
            NeonDotprod: neon,
            NeonI8mm: neon,
            Simd128: simd128,
        })
    };
    ($isa:expr, $function:ident($($argument:expr),* $(,)?)) => {
        $crate::isa::dispatch!(@short $isa, $function($($argument),*), avx512vnni)
    };
    ($isa:expr, $function:ident($($argument:expr),* $(,)?), with tiles) => {
        $crate::isa::dispatch!(@short $isa, $function($($argument),*), amx)
    };
    ($isa:expr, $function:ident($($argument:expr),* $(,)?), {
        Scalar: $scalar:ident,
        Avx2: $avx2:ident,
        AvxVnni: $avxvnni:ident,
        Avx512Vnni: $avx512vnni:ident,
        Avx512Bf16: $avx512bf16:ident,
        Amx: $amx:ident,
        Neon: $neon:ident,
        NeonDotprod: $neon_dotprod:ident,
        NeonI8mm: $neon_i8mm:ident,
        Simd128: $simd128:ident $(,)?
    }) => {
        match $isa.backend() {
            $crate::isa::Backend::Scalar => $scalar::$function($($argument),*),
            #[cfg(target_arch = "x86_64")]
            $crate::isa::Backend::Avx2(token) => $crate::isa::dispatch!(@call $avx2 $function token ($($argument),*)),
            #[cfg(target_arch = "x86_64")]
            $crate::isa::Backend::AvxVnni(token) => $crate::isa::dispatch!(@call $avxvnni $function token ($($argument),*)),
            #[cfg(target_arch = "x86_64")]
            $crate::isa::Backend::Avx512Vnni(token) => $crate::isa::dispatch!(@call $avx512vnni $function token ($($argument),*)),
            #[cfg(target_arch = "x86_64")]
            $crate::isa::Backend::Avx512Bf16(token) => $crate::isa::dispatch!(@call $avx512bf16 $function token ($($argument),*)),
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            $crate::isa::Backend::Amx(token) => $crate::isa::dispatch!(@call $amx $function token ($($argument),*)),
            #[cfg(target_arch = "aarch64")]
            $crate::isa::Backend::Neon(token) => $crate::isa::dispatch!(@call $neon $function token ($($argument),*)),
            #[cfg(target_arch = "aarch64")]
            $crate::isa::Backend::NeonDotprod(token) => $crate::isa::dispatch!(@call $neon_dotprod $function token ($($argument),*)),
            #[cfg(target_arch = "aarch64")]
            $crate::isa::Backend::NeonI8mm(token) => $crate::isa::dispatch!(@call $neon_i8mm $function token ($($argument),*)),
            #[cfg(target_arch = "wasm32")]
            $crate::isa::Backend::Simd128(token) => $crate::isa::dispatch!(@call $simd128 $function token ($($argument),*)),
        }
    };
}

/// Makes functions that run with the features of their first parameter, a token, safe to call from
/// any code.
///
/// `fn f(token: Avx2, x: X) { .. }` becomes a function without target features that calls one with
/// these features.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! entry {
    (@features Avx2 $($function:tt)*) => { #[umo_kernels_features::avx2] $($function)* };
    (@features AvxVnni $($function:tt)*) => { #[umo_kernels_features::avxvnni] $($function)* };
    (@features Avx512Vnni $($function:tt)*) => { #[umo_kernels_features::avx512vnni] $($function)* };
    // `vdpbf16ps` is issued by assembly (`bf16::avx512bf16`), so that the loops of AVX-512 are shared.
    (@features Avx512Bf16 $($function:tt)*) => { #[umo_kernels_features::avx512vnni] $($function)* };
    (@features Amx $($function:tt)*) => { #[umo_kernels_features::avx512bf16] $($function)* };
    (@features Neon $($function:tt)*) => { #[umo_kernels_features::neon] $($function)* };
    (@features NeonDotprod $($function:tt)*) => { #[umo_kernels_features::neon_dotprod] $($function)* };
    (@features NeonI8mm $($function:tt)*) => { #[umo_kernels_features::neon_i8mm] $($function)* };
    ($(
        $(#[$meta:meta])*
        $visibility:vis fn $name:ident $(<$generic:ident: $bound:path>)?
            ($token:ident: $Token:ident $(, $argument:ident: $type:ty)* $(,)?) $(-> $result:ty)? $body:block
    )*) => {$(
        $(#[$meta])*
        $visibility fn $name $(<$generic: $bound>)? ($token: $Token $(, $argument: $type)*) $(-> $result)? {
            $crate::isa::entry! {
                @features $Token
                fn with_features $(<$generic: $bound>)? ($token: $Token $(, $argument: $type)*) $(-> $result)? $body
            }
            // SAFETY: the token exists only if the processor has the features of
            // `with_features`, which its constructor in `isa` detected: the attributes above enable the
            // same ones.
            unsafe { with_features($token $(, $argument)*) }
        }
    )*};
}

pub(crate) use dispatch;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) use entry;

//! Functions of real numbers with the same bits on every system: those of the crate `libm` in place of the system's library,
//! which the standard library calls.

/// Functions of a float with the same bits on every system.
pub trait Functions: Copy {
    /// `e^x`.
    #[must_use]
    fn exponential(self) -> Self;
    /// `e^x - 1`.
    #[must_use]
    fn exponential_less_one(self) -> Self;
    /// The natural logarithm.
    #[must_use]
    fn logarithm(self) -> Self;
    /// The logarithm to base 2.
    #[must_use]
    fn logarithm_2(self) -> Self;
    /// The logarithm to base 10.
    #[must_use]
    fn logarithm_10(self) -> Self;
    /// The sine of radians.
    #[must_use]
    fn sine(self) -> Self;
    /// The cosine of radians.
    #[must_use]
    fn cosine(self) -> Self;
    /// The inverse of the cosine, in radians.
    #[must_use]
    fn arc_cosine(self) -> Self;
    /// The inverse of the tangent, in radians.
    #[must_use]
    fn arc_tangent(self) -> Self;
    /// The hyperbolic tangent.
    #[must_use]
    fn hyperbolic_tangent(self) -> Self;
    /// `self^y`.
    #[must_use]
    fn power(self, y: Self) -> Self;
    /// The angle of the point `(x, self)`, in radians.
    #[must_use]
    fn arc_tangent_over(self, x: Self) -> Self;

    /// The sine and the cosine of radians.
    #[must_use]
    fn sine_cosine(self) -> (Self, Self) {
        (self.sine(), self.cosine())
    }
}

macro_rules! functions {
    ($float:ty, $power:ident, $arc_tangent:ident, $($name:ident = $function:ident),*) => {
        impl Functions for $float {
            $(
                fn $name(self) -> Self {
                    libm::$function(self)
                }
            )*

            fn power(self, y: Self) -> Self {
                libm::$power(self, y)
            }

            fn arc_tangent_over(self, x: Self) -> Self {
                libm::$arc_tangent(self, x)
            }
        }
    };
}

functions!(
    f32,
    powf,
    atan2f,
    exponential = expf,
    exponential_less_one = expm1f,
    logarithm = logf,
    logarithm_2 = log2f,
    logarithm_10 = log10f,
    sine = sinf,
    cosine = cosf,
    arc_cosine = acosf,
    arc_tangent = atanf,
    hyperbolic_tangent = tanhf
);

functions!(
    f64,
    pow,
    atan2,
    exponential = exp,
    exponential_less_one = expm1,
    logarithm = log,
    logarithm_2 = log2,
    logarithm_10 = log10,
    sine = sin,
    cosine = cos,
    arc_cosine = acos,
    arc_tangent = atan,
    hyperbolic_tangent = tanh
);

#[cfg(test)]
mod tests {
    use super::*;

    /// Each is the function of its name: within an ulp or two of the system's.
    #[test]
    fn functions_are_near_the_system_s() {
        for x in (1..200).map(|i| 0.005 * f64::from(i)) {
            let pairs = [
                (x.exponential(), x.exp()),
                (x.exponential_less_one(), x.exp_m1()),
                (x.logarithm(), x.ln()),
                (x.logarithm_2(), x.log2()),
                (x.logarithm_10(), x.log10()),
                (x.sine(), x.sin()),
                (x.cosine(), x.cos()),
                (x.arc_cosine(), x.acos()),
                (x.arc_tangent(), x.atan()),
                (x.hyperbolic_tangent(), x.tanh()),
                (x.power(1.7), x.powf(1.7)),
                (x.arc_tangent_over(-0.3), x.atan2(-0.3)),
                (x.sine_cosine().1, x.cos()),
            ];
            for (i, (ours, system)) in pairs.into_iter().enumerate() {
                assert!(
                    (ours - system).abs() <= 4e-16 * system.abs().max(1e-3),
                    "function {i} of {x}: {ours}, {system}"
                );
            }
        }
        // Bits, so that no system has others.
        assert_eq!(
            [0.7_f32.sine(), 0.7_f32.exponential(), 0.7_f32.logarithm()].map(f32::to_bits),
            [0x3f24_eb73, 0x4000_e153, 0xbeb6_9e1a]
        );
    }
}

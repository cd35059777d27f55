//! One function body compiled twice: for any processor, and for one with wider vectors.

/// Defines a function whose loops the compiler turns into vectors, once for every processor and once with
/// AVX2, and calls the one that fits. The body is the same, so the results are.
macro_rules! widened {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? $body:block) => {
        $(#[$meta])*
        #[inline]
        $visibility fn $name($($argument: $type),*) $(-> $result)? {
            #[inline(always)]
            fn portable($($argument: $type),*) $(-> $result)? $body

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn wide($($argument: $type),*) $(-> $result)? {
                portable($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2.
                return unsafe { wide($($argument),*) };
            }
            portable($($argument),*)
        }
    };
}

pub(crate) use widened;

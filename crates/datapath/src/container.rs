//! The integer containers of deployed words.

/// A signed integer that holds a deployed word.
pub trait Container: Copy {
    /// Sign-extended.
    fn to_i64(self) -> i64;
    /// Sign-extended, or the low 32 bits of a 64-bit container.
    fn to_i32(self) -> i32;
    /// Sign-extended, or the low 16 bits of a wider container.
    fn to_i16(self) -> i16;
    /// The low bits.
    fn from_i64(value: i64) -> Self;
    /// The low bits, sign-extended.
    fn from_i32(value: i32) -> Self;
}

macro_rules! container {
    ($($int:ty)*) => {$(
        impl Container for $int {
            #[inline(always)]
            fn to_i64(self) -> i64 { self as i64 }
            #[inline(always)]
            fn to_i32(self) -> i32 { self as i32 }
            #[inline(always)]
            fn to_i16(self) -> i16 { self as i16 }
            #[inline(always)]
            fn from_i64(value: i64) -> Self { value as Self }
            #[inline(always)]
            fn from_i32(value: i32) -> Self { value as Self }
        }
    )*};
}
container!(i8 i16 i32 i64);

//! Small dense matrices as plain arrays, stored by column so that products vectorise.
//!
//! Sums run in a fixed order without fused operations, so every host gives the same bits.

/// A column.
pub type Vector<const N: usize> = [f64; N];

/// A square matrix: `m[column][row]`.
pub type Matrix<const N: usize> = [Vector<N>; N];

/// The unit matrix.
#[must_use]
pub fn identity<const N: usize>() -> Matrix<N> {
    std::array::from_fn(|c| std::array::from_fn(|r| f64::from(u8::from(r == c))))
}

/// `m x`.
#[inline]
#[must_use]
pub fn apply<const N: usize>(m: &Matrix<N>, x: &Vector<N>) -> Vector<N> {
    let mut y = [0.0; N];
    for (column, value) in m.iter().zip(x) {
        add_scaled(&mut y, column, *value);
    }
    y
}

/// `y += s x`.
#[inline]
pub fn add_scaled<const N: usize>(y: &mut Vector<N>, x: &Vector<N>, s: f64) {
    for (to, from) in y.iter_mut().zip(x) {
        *to += s * from;
    }
}

/// `a b`.
#[must_use]
pub fn product<const N: usize>(a: &Matrix<N>, b: &Matrix<N>) -> Matrix<N> {
    std::array::from_fn(|c| apply(a, &b[c]))
}

/// `a + s b`.
#[must_use]
pub fn sum_scaled<const N: usize>(a: &Matrix<N>, b: &Matrix<N>, s: f64) -> Matrix<N> {
    let mut out = *a;
    for (to, from) in out.iter_mut().zip(b) {
        add_scaled(to, from, s);
    }
    out
}

/// The transpose.
#[must_use]
pub fn transposed<const N: usize>(m: &Matrix<N>) -> Matrix<N> {
    std::array::from_fn(|c| std::array::from_fn(|r| m[r][c]))
}

/// `f q f'`, a covariance carried through a linear map.
#[must_use]
pub fn carried<const N: usize>(f: &Matrix<N>, q: &Matrix<N>) -> Matrix<N> {
    product(&product(f, q), &transposed(f))
}

/// Largest sum of magnitudes in a column.
#[must_use]
pub fn one_norm<const N: usize>(m: &Matrix<N>) -> f64 {
    m.iter()
        .map(|c| c.iter().map(|v| v.abs()).sum())
        .fold(0.0, f64::max)
}

/// Solves `m x = y` by elimination with row pivots; none if `m` is singular.
#[must_use]
pub fn solve<const N: usize>(m: &Matrix<N>, y: &Vector<N>) -> Option<Vector<N>> {
    let (mut m, mut y) = (*m, *y);
    for k in 0..N {
        let pivot = (k..N).max_by(|a, b| m[k][*a].abs().total_cmp(&m[k][*b].abs()))?;
        if m[k][pivot] == 0.0 || !m[k][pivot].is_finite() {
            return None;
        }
        m.iter_mut().for_each(|column| column.swap(k, pivot));
        y.swap(k, pivot);
        for row in k + 1..N {
            let factor = m[k][row] / m[k][k];
            m.iter_mut()
                .skip(k)
                .for_each(|column| column[row] -= factor * column[k]);
            y[row] -= factor * y[k];
        }
    }
    for k in (0..N).rev() {
        let known: f64 = (k + 1..N).map(|c| m[c][k] * y[c]).sum();
        y[k] = (y[k] - known) / m[k][k];
    }
    Some(y)
}

/// Columns of a factor L with L L' = q for a positive semidefinite `q`; columns of vanished
/// directions are left out.
#[must_use]
pub fn factor<const N: usize>(q: &Matrix<N>) -> Vec<Vector<N>> {
    /// A pivot under this share of its diagonal element is rounding.
    const VANISHED: f64 = 1e-12;
    let mut rest = *q;
    let mut columns = Vec::new();
    for k in 0..N {
        let pivot = rest[k][k];
        if !(pivot > VANISHED * q[k][k] && pivot >= f64::MIN_POSITIVE) {
            continue;
        }
        let root = pivot.sqrt();
        let mut column = [0.0; N];
        for row in k..N {
            column[row] = rest[k][row] / root;
        }
        for (c, part) in rest.iter_mut().enumerate() {
            add_scaled(part, &column, -column[c]);
        }
        columns.push(column);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type M4 = Matrix<4>;

    proptest! {
        #[test]
        fn a_solution_satisfies_its_equations(m in matrices(), y in prop::array::uniform4(-1.0..1.0)) {
            let m = sum_scaled(&m, &identity(), 5.0);
            let x = solve(&m, &y).expect("dominant diagonal");
            for (left, right) in apply(&m, &x).iter().zip(&y) {
                prop_assert!((left - right).abs() < 1e-12);
            }
        }

        #[test]
        fn a_factor_gives_back_its_covariance_also_when_singular(mut a in matrices(), rank in 1_usize..=4) {
            a.iter_mut().skip(rank).for_each(|column| *column = [0.0; 4]);
            let q = product(&a, &transposed(&a));
            let columns = factor(&q);
            let mut back = [[0.0; 4]; 4];
            for column in &columns {
                for (c, part) in back.iter_mut().enumerate() {
                    add_scaled(part, column, column[c]);
                }
            }
            // A direction left out holds under 1e-12 of a variance, 1e-6 of a covariance.
            prop_assert!(one_norm(&sum_scaled(&back, &q, -1.0)) < 1e-5, "{back:?} {q:?}");
        }
    }

    fn matrices() -> impl Strategy<Value = M4> {
        prop::array::uniform4(prop::array::uniform4(-1.0..1.0))
    }

    #[test]
    fn a_singular_matrix_has_no_solution() {
        assert_eq!(solve(&[[1.0, 2.0], [2.0, 4.0]], &[1.0, 0.0]), None);
    }
}

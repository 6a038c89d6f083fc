//! Least squares of one channel over the attitudes: a = s . v + c.
//!
//! Normal equations, scaled by nature (all columns are of the order of one) and refused when
//! ill-conditioned, solved by Cholesky's factors; eigenvalues by Jacobi's rotations. Both use only
//! operations that are exact everywhere, so that every host finds the same bits.

use nalgebra::{Matrix4, Vector4};

use crate::error::Error;

/// Parameters of a channel: sensitivities to x, y, z, and the constant.
const PARAMETERS: usize = 4;

/// Observations needed: two more than parameters.
pub(crate) const LEAST: usize = PARAMETERS + 2;

/// Largest condition number: at that of an upright cone of 60 degrees (11) offsets and sensitivities
/// to z still separate; at 50 (a cone of 30 degrees) the offset's standard error is some 30 times
/// that of a whole sphere.
const CONDITION_LIMIT: f64 = 50.0;

/// Constant and last of the parameters.
pub(crate) const OFFSET: usize = 3;

/// The attitudes as the design of the experiment.
pub(crate) struct Design {
    pub(crate) vector: &'static str,
    rows: Vec<Vector4<f64>>,
    /// Inverse of the normal matrix: covariances over the variance of an average.
    pub(crate) inverse: Matrix4<f64>,
    pub(crate) condition: f64,
}

/// A channel's parameters.
pub(crate) struct Fit {
    pub(crate) parameters: Vector4<f64>,
    pub(crate) variance: f64,
    pub(crate) residuals: Vec<f64>,
}

impl Design {
    pub(crate) fn new(vector: &'static str, references: &[[f64; 3]]) -> Result<Self, Error> {
        let rows: Vec<Vector4<f64>> = references
            .iter()
            .map(|v| Vector4::new(v[0], v[1], v[2], 1.0))
            .collect();
        let normal: Matrix4<f64> = rows.iter().map(|row| row * row.transpose()).sum();
        let (values, vectors) = eigen(normal);
        let (least, most) = (values.imin(), values.max());
        let condition = (most / values[least].max(0.0)).sqrt();
        let inverse = normal.cholesky().map(|factors| factors.inverse());
        match inverse {
            Some(inverse) if condition <= CONDITION_LIMIT => Ok(Self {
                vector,
                rows,
                inverse,
                condition,
            }),
            _ => Err(degenerate(
                vector,
                references,
                vectors.column(least).into(),
                condition,
            )),
        }
    }

    pub(crate) fn fit(&self, averages: impl Iterator<Item = f64> + Clone) -> Fit {
        let moments: Vector4<f64> = self
            .rows
            .iter()
            .zip(averages.clone())
            .map(|(row, average)| row * average)
            .sum();
        let parameters = self.inverse * moments;
        let residuals: Vec<f64> = self
            .rows
            .iter()
            .zip(averages)
            .map(|(row, average)| average - row.dot(&parameters))
            .collect();
        Fit {
            parameters,
            variance: variance(&residuals),
            residuals,
        }
    }
}

/// Estimated variance of what a fit leaves: the degrees of freedom are taken off.
pub(crate) fn variance(residuals: &[f64]) -> f64 {
    let square: f64 = residuals.iter().map(|residual| residual * residual).sum();
    square / (residuals.len() - PARAMETERS) as f64
}

/// Names the axes that take part in the combination `open` of parameters.
fn degenerate(
    vector: &'static str,
    references: &[[f64; 3]],
    open: Vector4<f64>,
    condition: f64,
) -> Error {
    let largest = (0..OFFSET).fold(0.0, |most: f64, axis| most.max(open[axis].abs()));
    let taking_part: Vec<usize> = (0..OFFSET)
        .filter(|&axis| open[axis].abs() >= 0.3 * largest)
        .collect();
    let axes: Vec<&str> = taking_part
        .iter()
        .map(|&axis| ["x", "y", "z"][axis])
        .collect();
    let ranges: Vec<String> = taking_part
        .iter()
        .map(|&axis| {
            let values = references.iter().map(|v| v[axis]);
            let least = values.clone().fold(f64::INFINITY, f64::min);
            let most = values.fold(f64::NEG_INFINITY, f64::max);
            format!("{least:.2} to {most:.2}")
        })
        .collect();
    let covers = if axes.len() == 1 {
        format!("stays within {}", ranges.join(", "))
    } else {
        format!("(within {}) goes together", ranges.join(", "))
    };
    Error::Degenerate {
        vector,
        axes: axes.join(" and "),
        covers,
        condition,
        limit: CONDITION_LIMIT,
    }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix, by cyclic Jacobi rotations.
fn eigen(mut a: Matrix4<f64>) -> (Vector4<f64>, Matrix4<f64>) {
    let mut vectors = Matrix4::identity();
    // Converges quadratically: a handful of sweeps reach the last bit.
    for _ in 0..12 {
        for p in 0..PARAMETERS {
            for q in p + 1..PARAMETERS {
                if a[(p, q)] != 0.0 {
                    let rotation = jacobi(&a, p, q);
                    a = rotation.transpose() * a * rotation;
                    vectors *= rotation;
                }
            }
        }
    }
    (a.diagonal(), vectors)
}

/// The rotation that makes element (p, q) vanish (Golub and Van Loan, 8.4).
fn jacobi(a: &Matrix4<f64>, p: usize, q: usize) -> Matrix4<f64> {
    let tau = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
    let tangent = tau.signum() / (tau.abs() + (1.0 + tau * tau).sqrt());
    let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
    let mut rotation = Matrix4::identity();
    rotation[(p, p)] = cosine;
    rotation[(q, q)] = cosine;
    rotation[(p, q)] = tangent * cosine;
    rotation[(q, p)] = -tangent * cosine;
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eigenvectors_diagonalise() {
        let a = Matrix4::new(
            4.0, 1.0, -2.0, 0.5, 1.0, 3.0, 0.25, 0.0, -2.0, 0.25, 5.0, 1.5, 0.5, 0.0, 1.5, 2.0,
        );
        let (values, vectors) = eigen(a);
        let back = vectors * Matrix4::from_diagonal(&values) * vectors.transpose();
        assert!((back - a).norm() < 1e-13);
        assert!((vectors * vectors.transpose() - Matrix4::identity()).norm() < 1e-13);
    }
}

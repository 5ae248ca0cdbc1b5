#pragma once

/// Elementary functions that give the same bits on every machine: only +, -, *, / and sqrt, which
/// IEEE 754 rounds correctly. libm picks other code, and other last bits, for other processors.
namespace weft::det {

/// e^x within 4e-16 relative; 0 below -708, infinity above 709.
double exp(double x);

/// Natural logarithm of a positive finite x within 4e-16 relative or absolute.
double log(double x);

/// Angle of (x, y) in (-pi, pi] within 4e-16; 0 for (0, 0).
double atan2(double y, double x);

/// 1 / (1 + e^-x)
inline double logistic(double x) { return 1.0 / (1.0 + exp(-x)); }

}  // namespace weft::det

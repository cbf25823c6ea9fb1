// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace skytree {

/// Scores of `count` planes: n is the solid angle, q the quantity (power or square) of the parts
/// before and behind each.

/// S1^2/n1 + S2^2/n2 with S the power: largest where the pooled variance of the parts is least (the
/// paper's).
void pooled_variance_scores(const double* n1, const double* q1, const double* n2, const double* q2,
                            int count, double* scores);

/// -(sqrt(n1 Q1) + sqrt(n2 Q2)) with Q the square.
void min_variance_scores(const double* n1, const double* q1, const double* n2, const double* q2,
                         int count, double* scores);

}  // namespace skytree

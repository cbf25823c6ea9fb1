// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// Before a function whose loops vectorise: the compiler makes it twice, and the program takes the
/// one for 8 lanes where the processor has AVX2. Both give the same bits, as neither contracts to
/// fma.
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__SANITIZE_ADDRESS__)
#define SKY_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define SKY_CLONES
#endif

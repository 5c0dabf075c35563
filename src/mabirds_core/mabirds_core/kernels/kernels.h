/* What all kernels have in common. */
#ifndef MABIRDS_KERNELS_H
#define MABIRDS_KERNELS_H

#include <stdint.h>

/* Wider registers where the processor has them. Results are the same bits: without fused multiplications (setup.py
   says so to the compiler) a lane of any register rounds alike, and sums are written lane by lane. */
#if defined(KERNEL) /* tests build them for one kind of processor */
#elif defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define KERNEL __attribute__((visibility("default"), target_clones("arch=x86-64-v4", "avx2", "default")))
#else
#define KERNEL __attribute__((visibility("default")))
#endif

#endif

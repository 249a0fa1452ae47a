/* The model's kernels, compiled by Numba. For x86-64 the step is there twice: once for every processor, and once with
   AVX2. Both give the same bits.

   AVX2 handles four numbers at once where the other step handles two and two; it is used without fused products. */

#ifndef MODEL_H
#define MODEL_H

#include <stdint.h>

typedef int64_t Step(double *z, double h);

int64_t initialize(double *z);   /* 0, or a fault's number */
int64_t outputs(double *z);      /* refreshes the outputs */
int64_t output_rates(double *z); /* refreshes their derivatives; not every model has it */
int64_t feedthrough(double *z, double *change); /* sets how much outputs change at once as inputs do; keeps z */
Step step;                       /* 0, or not 0 where nothing has changed */

#ifdef __x86_64__
#include <cpuid.h>

Step step_avx2;

enum { OSXSAVE = 1 << 27, AVX = 1 << 28, AVX2 = 1 << 5, XMM_AND_YMM = 1 << 1 | 1 << 2 };

/* Whether these words allow AVX2: ecx of leaf 1, ebx of leaf 7, and XCR0, which says which registers the system saves
   when it switches between threads. */
static inline int avx2_in(unsigned leaf_1_ecx, unsigned leaf_7_ebx, unsigned xcr0) {
    return (leaf_1_ecx & OSXSAVE) && (leaf_1_ecx & AVX) && (leaf_7_ebx & AVX2) && (xcr0 & XMM_AND_YMM) == XMM_AND_YMM;
}

static inline int has_avx2(void) {
    unsigned eax, ebx, ecx, edx, leaf_1_ecx, xcr0;
    if (!__get_cpuid(1, &eax, &ebx, &leaf_1_ecx, &edx) || !(leaf_1_ecx & OSXSAVE)) return 0;
    if (!__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx)) return 0;
    __asm__("xgetbv" : "=a"(xcr0), "=d"(edx) : "c"(0));
    return avx2_in(leaf_1_ecx, ebx, xcr0);
}

#ifndef USES_AVX2 /* a test may define it as 0 or 1 */
#define USES_AVX2 has_avx2()
#endif
#endif

/* The step for this processor. */
static inline Step *chosen_step(void) {
#ifdef __x86_64__
    if (USES_AVX2) return step_avx2;
#endif
    return step;
}

#endif

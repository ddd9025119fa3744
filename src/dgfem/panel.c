#pragma once
#include "base.c"
/* Panels of the Cholesky factor, and the instruction sets that their dense kernels are compiled for and chosen from.

   A panel is what one supernode has of L: a lower triangle D over a rectangle B, of the same columns. It is stored in
   strips of rows (see kernels.c), first those of D, each with the columns up to its own last row, then those of B; both
   are padded with rows of zeros to whole strips. D's diagonal holds the reciprocals of L's. The update U of a supernode
   is stored in strips of the same size, as D is. */

typedef struct dgfemi_panel {
    dgfem_real *values;
    int width, height; /* columns; rows of B */
} dgfemi_panel;

/* Consecutive rows (or columns) of a child's update that are consecutive in its parent's front too, on one side of its
   width. */
typedef struct dgfemi_run {
    int row, front_row, length;
} dgfemi_run;

/* A child's update and where it goes: its columns by runs; its rows by segments, which are runs cut at the ends of all
   strips. Either the columns of the panel are added to, then update is NULL, or those of the front's own update. */
typedef struct dgfemi_extension {
    const dgfem_real *child;
    const dgfemi_run *runs, *segments;
    int run_count;
    dgfemi_panel panel;
    dgfem_real *update;
} dgfemi_extension;

/* A stored block of A and where it goes in a front: as it is, or transposed where the order of elimination swaps its
   row and column. */
typedef struct dgfemi_entry {
    int block, rows, columns;
    int front_row, front_column, transposed;
} dgfemi_entry;

/* Small matrices and vectors for assembly: a 3x3 matrix takes three rows of four numbers and fills whole vectors of
   every path, a vector takes four numbers. The fourth ones, and those that fill up, are zeros. */
enum {
    DGFEM_MATRIX_STRIDE = 16,
    DGFEM_VECTOR_STRIDE = 4,
    DGFEM_MATRICES_IN_A_ROW = 20
};

/* Rows of 3x3 matrices, each the sum of `inner` (2, 8 or 9) ones, those of b, with factors in a: row i has `count` of
   them, or i + 1 if that is 0. Its factors begin `step` + i `growth` numbers behind those of row i - 1. They are added
   to a row-major block whose rows have `stride` numbers. */
typedef struct dgfemi_sums {
    const dgfem_real *a, *b[3]; /* b: the first two, three more, the rest */
    int inner, rows, count, step, growth;
    dgfem_real *out;
    int stride, room; /* numbers from `out` to the end of its row */
} dgfemi_sums;

/* The kernels for one instruction set. Ranges are of strips, or of segments. */
typedef struct dgfemi_kernels {
    dgfem_simd simd;
    int strip, tile, lanes; /* rows of a strip, columns of a tile, reals of a vector */
    int (*factor_strips)(const dgfemi_panel *p, int first, int last, int from, int to, const dgfem_real *diagonal);
    void (*update_strips)(const dgfemi_panel *p, int first, int last, int from, int to);
    void (*make_update)(const dgfemi_panel *p, dgfem_real *u, int first, int last);
    void (*clear_panel)(const dgfemi_panel *p, int first, int last);
    void (*add_update)(const dgfemi_extension *extension, int first, int last);
    void (*add_block)(const dgfemi_panel *p, const dgfemi_entry *entry, const dgfem_real *block);
    void (*solve_panel)(const dgfemi_panel *p, dgfem_real *x, dgfem_real *below);
    void (*solve_panel_transposed)(const dgfemi_panel *p, dgfem_real *x, const dgfem_real *below, dgfem_real *sums);
    void (*multiply_block)(const dgfem_real *a, int rows, int columns, const dgfem_real *x, dgfem_real *y,
                           const dgfem_real *z, dgfem_real *w);
    void (*add_matrices)(const dgfemi_sums *sums);
    void (*set_elastic)(dgfem_real lambda, dgfem_real mu, const dgfem_real *u, const dgfem_real *v, dgfem_real *k);
    void (*transform)(const dgfem_real *k, int count, const dgfem_real *v, dgfem_real *out);
    void (*add_vectors)(const dgfem_real **parts, int count, const dgfem_real *b, dgfem_real *out);
} dgfemi_kernels;

#ifdef DGFEM_USE_BLAS
# include <cblas.h>
#endif

enum {
    DGFEM_PANEL_COLUMNS = 240, /* columns that are factored before they update the rest; whole strips of every path */
    DGFEM_UPDATE_COLUMNS = 144 /* columns that are updated together: their strips stay in cache; likewise */
};

/* A pivot that round-off has left of the diagonal element of A carries no digit: such a matrix is singular to working
   precision, and the pivot counts as not positive. */
#define DGFEM_PIVOT_THRESHOLD ((dgfem_real)(8 * DGFEM_EPSILON))

static int dgfemi_pivot_is_good(dgfem_real pivot, dgfem_real diagonal) {
    return pivot > DGFEM_PIVOT_THRESHOLD * dgfemi_abs(diagonal) && dgfemi_is_finite(pivot);
}

/* Loops of a few constant iterations, whose arrays then live in registers; and the one that must not be unrolled. */
#if defined(__clang__)
#define DGFEM_UNROLL _Pragma("clang loop unroll(full)")
#define DGFEM_ROLLED _Pragma("clang loop unroll(disable)")
#elif defined(__GNUC__)
#define DGFEM_UNROLL _Pragma("GCC unroll 16")
#define DGFEM_ROLLED _Pragma("GCC unroll 1")
#else
#define DGFEM_UNROLL
#define DGFEM_ROLLED
#endif

/* ---- plain C ---- */

#define DGFEM_PATH(name) name##_plain
#define DGFEM_FOUR(name) name##_plain
#define DGFEM_PATH_ID DGFEM_SIMD_NONE
#define DGFEM_VECTOR dgfem_real
#define DGFEM_V_LANES 1
#define DGFEM_VECTORS 4
#define DGFEM_TILE 4
#define DGFEM_V_LOAD(p) (*(p))
#define DGFEM_V_STORE(p, v) (*(p) = (v))
#define DGFEM_V_ALL(x) ((dgfem_real)(x))
#define DGFEM_V_ADD(a, b) ((a) + (b))
#define DGFEM_V_SUB(a, b) ((a) - (b))
#define DGFEM_V_MUL(a, b) ((a) * (b))
#define DGFEM_V_FMA(a, b, c) ((a) * (b) + (c))
#define DGFEM_V_FNMA(a, b, c) ((c) - (a) * (b))
#include "kernels.c"

/* ---- x86 ---- */

#if !defined(DGFEM_NO_SIMD) && defined(__GNUC__) && defined(__SSE2__) && (defined(__x86_64__) || defined(__i386__))
#define DGFEM_HAS_X86 1
#include <immintrin.h>

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_X86_NAME(prefix, op) prefix##op##_ps
#else
#define DGFEM_X86_NAME(prefix, op) prefix##op##_pd
#endif

#define DGFEM_PATH(name) name##_sse2
#define DGFEM_FOUR(name) name##_sse2
#define DGFEM_PATH_ID DGFEM_SIMD_SSE2
#define DGFEM_VECTORS 2
#define DGFEM_TILE 4
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_VECTOR __m128
#define DGFEM_V_LANES 4
#else
#define DGFEM_VECTOR __m128d
#define DGFEM_V_LANES 2
#endif
#define DGFEM_V_LOAD(p) DGFEM_X86_NAME(_mm_, loadu)(p)
#define DGFEM_V_STORE(p, v) DGFEM_X86_NAME(_mm_, storeu)(p, v)
#define DGFEM_V_ALL(x) DGFEM_X86_NAME(_mm_, set1)(x)
#define DGFEM_V_ADD(a, b) DGFEM_X86_NAME(_mm_, add)(a, b)
#define DGFEM_V_SUB(a, b) DGFEM_X86_NAME(_mm_, sub)(a, b)
#define DGFEM_V_MUL(a, b) DGFEM_X86_NAME(_mm_, mul)(a, b)
#define DGFEM_V_FMA(a, b, c) DGFEM_V_ADD(DGFEM_V_MUL(a, b), c)
#define DGFEM_V_FNMA(a, b, c) DGFEM_V_SUB(c, DGFEM_V_MUL(a, b))
#include "kernels.c"

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#endif
#define DGFEM_PATH(name) name##_avx2
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_FOUR(name) name##_sse2
#else
#define DGFEM_FOUR(name) name##_avx2
#endif
#define DGFEM_PATH_ID DGFEM_SIMD_AVX2
#define DGFEM_VECTORS 3
#define DGFEM_TILE 4
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_VECTOR __m256
#define DGFEM_V_LANES 8
#else
#define DGFEM_VECTOR __m256d
#define DGFEM_V_LANES 4
#endif
#define DGFEM_V_LOAD(p) DGFEM_X86_NAME(_mm256_, loadu)(p)
#define DGFEM_V_STORE(p, v) DGFEM_X86_NAME(_mm256_, storeu)(p, v)
#define DGFEM_V_ALL(x) DGFEM_X86_NAME(_mm256_, set1)(x)
#define DGFEM_V_ADD(a, b) DGFEM_X86_NAME(_mm256_, add)(a, b)
#define DGFEM_V_SUB(a, b) DGFEM_X86_NAME(_mm256_, sub)(a, b)
#define DGFEM_V_MUL(a, b) DGFEM_X86_NAME(_mm256_, mul)(a, b)
#define DGFEM_V_FMA(a, b, c) DGFEM_X86_NAME(_mm256_, fmadd)(a, b, c)
#define DGFEM_V_FNMA(a, b, c) DGFEM_X86_NAME(_mm256_, fnmadd)(a, b, c)
#include "kernels.c"
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx512f,fma"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx512f,fma")
#endif
#define DGFEM_PATH(name) name##_avx512
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_FOUR(name) name##_sse2
#else
#define DGFEM_FOUR(name) name##_avx2
#endif
#define DGFEM_PATH_ID DGFEM_SIMD_AVX512
#define DGFEM_VECTORS 3
#define DGFEM_TILE 8
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_VECTOR __m512
#define DGFEM_V_LANES 16
#else
#define DGFEM_VECTOR __m512d
#define DGFEM_V_LANES 8
#endif
#define DGFEM_V_LOAD(p) DGFEM_X86_NAME(_mm512_, loadu)(p)
#define DGFEM_V_STORE(p, v) DGFEM_X86_NAME(_mm512_, storeu)(p, v)
#define DGFEM_V_ALL(x) DGFEM_X86_NAME(_mm512_, set1)(x)
#define DGFEM_V_ADD(a, b) DGFEM_X86_NAME(_mm512_, add)(a, b)
#define DGFEM_V_SUB(a, b) DGFEM_X86_NAME(_mm512_, sub)(a, b)
#define DGFEM_V_MUL(a, b) DGFEM_X86_NAME(_mm512_, mul)(a, b)
#define DGFEM_V_FMA(a, b, c) DGFEM_X86_NAME(_mm512_, fmadd)(a, b, c)
#define DGFEM_V_FNMA(a, b, c) DGFEM_X86_NAME(_mm512_, fnmadd)(a, b, c)
#include "kernels.c"
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif
#endif

/* ---- ARM and WebAssembly ---- */

#if !defined(DGFEM_NO_SIMD) && defined(__aarch64__) && defined(__ARM_NEON)
#define DGFEM_HAS_NEON 1
# include <arm_neon.h>
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_NEON_NAME(op) op##_f32
#define DGFEM_VECTOR float32x4_t
#define DGFEM_V_LANES 4
#else
#define DGFEM_NEON_NAME(op) op##_f64
#define DGFEM_VECTOR float64x2_t
#define DGFEM_V_LANES 2
#endif
#define DGFEM_PATH(name) name##_neon
#define DGFEM_FOUR(name) name##_neon
#define DGFEM_PATH_ID DGFEM_SIMD_NEON
#define DGFEM_VECTORS 4
#define DGFEM_TILE 4
#define DGFEM_V_LOAD(p) DGFEM_NEON_NAME(vld1q)(p)
#define DGFEM_V_STORE(p, v) DGFEM_NEON_NAME(vst1q)(p, v)
#define DGFEM_V_ALL(x) DGFEM_NEON_NAME(vdupq_n)(x)
#define DGFEM_V_ADD(a, b) DGFEM_NEON_NAME(vaddq)(a, b)
#define DGFEM_V_SUB(a, b) DGFEM_NEON_NAME(vsubq)(a, b)
#define DGFEM_V_MUL(a, b) DGFEM_NEON_NAME(vmulq)(a, b)
#define DGFEM_V_FMA(a, b, c) DGFEM_NEON_NAME(vfmaq)(c, a, b)
#define DGFEM_V_FNMA(a, b, c) DGFEM_NEON_NAME(vfmsq)(c, a, b)
#include "kernels.c"
#endif

#if !defined(DGFEM_NO_SIMD) && defined(__wasm_simd128__)
#define DGFEM_HAS_WASM 1
# include <wasm_simd128.h>
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_WASM_NAME(op) wasm_f32x4_##op
#define DGFEM_V_LANES 4
#else
#define DGFEM_WASM_NAME(op) wasm_f64x2_##op
#define DGFEM_V_LANES 2
#endif
#define DGFEM_PATH(name) name##_wasm
#define DGFEM_FOUR(name) name##_wasm
#define DGFEM_PATH_ID DGFEM_SIMD_WASM
#define DGFEM_VECTOR v128_t
#define DGFEM_VECTORS 2
#define DGFEM_TILE 4
#define DGFEM_V_LOAD(p) wasm_v128_load(p)
#define DGFEM_V_STORE(p, v) wasm_v128_store(p, v)
#define DGFEM_V_ALL(x) DGFEM_WASM_NAME(splat)(x)
#define DGFEM_V_ADD(a, b) DGFEM_WASM_NAME(add)(a, b)
#define DGFEM_V_SUB(a, b) DGFEM_WASM_NAME(sub)(a, b)
#define DGFEM_V_MUL(a, b) DGFEM_WASM_NAME(mul)(a, b)
#define DGFEM_V_FMA(a, b, c) DGFEM_V_ADD(DGFEM_V_MUL(a, b), c)
#define DGFEM_V_FNMA(a, b, c) DGFEM_V_SUB(c, DGFEM_V_MUL(a, b))
#include "kernels.c"
#endif

/* ---- choice ---- */

/* The kernels for one instruction set; NULL where they were not compiled or the machine lacks it. */
static const dgfemi_kernels *dgfemi_kernels_for(dgfem_simd simd) {
    switch (simd) {
    case DGFEM_SIMD_NONE: return dgfemi_kernels_plain();
#ifdef DGFEM_HAS_X86
    case DGFEM_SIMD_SSE2: return dgfemi_kernels_sse2();
    case DGFEM_SIMD_AVX2:
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? dgfemi_kernels_avx2() : NULL;
    case DGFEM_SIMD_AVX512: return __builtin_cpu_supports("avx512f") ? dgfemi_kernels_avx512() : NULL;
#endif
#ifdef DGFEM_HAS_NEON
    case DGFEM_SIMD_NEON: return dgfemi_kernels_neon();
#endif
#ifdef DGFEM_HAS_WASM
    case DGFEM_SIMD_WASM: return dgfemi_kernels_wasm();
#endif
    default: return NULL;
    }
}

/* The same; of DGFEM_SIMD_AUTO the best there is. */
static const dgfemi_kernels *dgfemi_kernels_choose(dgfem_simd simd) {
    static const dgfem_simd best_first[6] = {DGFEM_SIMD_AVX512, DGFEM_SIMD_AVX2, DGFEM_SIMD_SSE2,
                                             DGFEM_SIMD_NEON,   DGFEM_SIMD_WASM, DGFEM_SIMD_NONE};
    const dgfemi_kernels *found = NULL;
    int i;
    if (simd != DGFEM_SIMD_AUTO) return dgfemi_kernels_for(simd);
    for (i = 0; i < 6 && !found; i++) found = dgfemi_kernels_for(best_first[i]);
    return found;
}

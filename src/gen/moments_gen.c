/* Prints src/dgfem/moments_generated.c: the recursion behind the integrals of all monomials up to a degree, as
   straight-line code.

       moments_gen DEGREE > moments_generated.c

   For a tetrahedron o, a, b, c, six times its volume s, the integral of x^i y^j z^k is i! j! k! / (i+j+k+3)! times the
   coefficient of t^(i,j,k) of s / (O A B C), with A = 1 - a.t and so on (P. Koehl, "Fast recursive computation of 3D
   geometric moments from surface meshes", 2012). For a triangle a, b, c, twice its area s, it is i! j! k! / (i+j+k+2)!
   times that of s / (A B C). The factor 1/O, common to all tetrahedra, is left to the end; two triangles that share the
   edge a-c, as neighbours in a fan do, are taken together:

            d                 s        s'         1   ( s    s' )
           / \             ------- + ------- =  ----- ( -  + -- )      s of (a,b,c),  s' of (a,c,d)
          a---c             A B C    A C D       A C  ( B    D )
           \ /
            b       and need only two passes of three terms for both:

       P(i,j,k) = s  (i+j+k)! / (i! j! k!) b_x^i b_y^j b_z^k            one product each, from a neighbour below
       Q(i,j,k) = s' (i+j+k)! / (i! j! k!) d_x^i d_y^j d_z^k
       C(i,j,k) = P(i,j,k) + Q(i,j,k) + c_x C(i-1,j,k) + c_y C(i,j-1,k) + c_z C(i,j,k-1)
       T(i,j,k) = C(i,j,k)            + a_x T(i-1,j,k) + a_y T(i,j-1,k) + a_z T(i,j,k-1) */
#include <stdio.h>
#include <stdlib.h>

enum { MAX_DEGREE = 12 }; /* names hold exponents as one hexadecimal digit; (MAX_DEGREE + 3)! is below 2^64 */

static int count_up_to(int degree) { return (degree + 1) * (degree + 2) * (degree + 3) / 6; }

/* The order of dgfem_monomial_index: by degree, then i descending, then j descending. */
static int index_in_layer(int j, int k) { return (j + k) * (j + k + 1) / 2 + k; }
static int monomial_index(int i, int j, int k) { return count_up_to(i + j + k - 1) + index_in_layer(j, k); }

/* Layers end a block where a caller may stop: after every even degree, and after the last one. */
static int block_end(int first, int degree) {
    int last = first % 2 ? first + 1 : first + 2;
    return last < degree ? last : degree;
}

static void print_name(char letter, int i, int j, int k) { printf("%c%x%x%x", letter, i, j, k); }

/* The terms v_x L(i-1,j,k) + v_y L(i,j-1,k) + v_z L(i,j,k-1) that exist. */
static void print_terms(char vertex, char letter, int i, int j, int k, int first) {
    int axis;
    for (axis = 0; axis < 3; axis++) {
        int e[3];
        e[0] = i, e[1] = j, e[2] = k;
        if (e[axis] == 0) continue;
        e[axis]--;
        printf(first ? "%c%c * " : " + %c%c * ", vertex, "xyz"[axis]);
        print_name(letter, e[0], e[1], e[2]);
        first = 0;
    }
}

/* The axis, the last one if several, along which the multinomial of (i,j,k) is a whole multiple (i+j+k)/e of its
   neighbour's below; -1 if there is none. */
static int whole_axis(int i, int j, int k, int *multiple) {
    int e[3], axis, best = -1;
    e[0] = i, e[1] = j, e[2] = k;
    for (axis = 0; axis < 3; axis++)
        if (e[axis] > 0 && (i + j + k) % e[axis] == 0) best = axis, *multiple = (i + j + k) / e[axis];
    return best;
}

static void print_multiple(char vertex, int axis, int multiple) {
    printf("%c%c", vertex, "xyz"[axis]);
    if (multiple > 1) printf("%d", multiple);
}

/* The multiples of the coordinates of b and d that print_power uses in these layers. */
static void print_multiples(int first, int last) {
    int axis, wanted, layer, i, j, multiple = 0;
    for (axis = 0; axis < 3; axis++)
        for (wanted = 2; wanted <= last; wanted++) {
            int used = 0, v;
            for (layer = first; layer <= last; layer++)
                for (i = layer; i >= 0; i--)
                    for (j = layer - i; j >= 0; j--)
                        if (whole_axis(i, j, layer - i - j, &multiple) == axis && multiple == wanted) used = 1;
            for (v = 0; used && v < 2; v++) {
                printf(v ? ", " : "        const dgfem_real ");
                print_multiple("bd"[v], axis, wanted);
                printf(" = %d * %c%c", wanted, "bd"[v], "xyz"[axis]);
                if (v) printf(";\n");
            }
        }
}

static void print_power(char letter, char vertex, int i, int j, int k) {
    int multiple = 0, axis = whole_axis(i, j, k, &multiple);
    printf("        const dgfem_real ");
    print_name(letter, i, j, k);
    printf(" = ");
    if (i + j + k == 0) printf("m->weight[%d][l]", letter == 'q');
    else if (axis < 0) print_terms(vertex, letter, i, j, k, 1);
    else {
        print_multiple(vertex, axis, multiple);
        printf(" * ");
        print_name(letter, i - (axis == 0), j - (axis == 1), k - (axis == 2));
    }
    printf(";\n");
}

static void print_monomial(int i, int j, int k) {
    print_power('p', 'b', i, j, k);
    print_power('q', 'd', i, j, k);
    printf("        const dgfem_real ");
    print_name('c', i, j, k);
    printf(" = ");
    print_name('p', i, j, k);
    printf(" + ");
    print_name('q', i, j, k);
    print_terms('c', 'c', i, j, k, 0);
    printf(";\n        const dgfem_real ");
    print_name('t', i, j, k);
    printf(" = ");
    print_name('c', i, j, k);
    print_terms('a', 't', i, j, k, 0);
    printf(";\n        m->sum[%d][l] += ", monomial_index(i, j, k));
    print_name('t', i, j, k);
    printf(";\n");
}

/* Whether print_power needs P(i,j,k) for a monomial of the next layer. */
static int power_is_used(int i, int j, int k) {
    int axis, multiple = 0;
    for (axis = 0; axis < 3; axis++) {
        int above = whole_axis(i + (axis == 0), j + (axis == 1), k + (axis == 2), &multiple);
        if (above < 0 || above == axis) return 1;
    }
    return 0;
}

static void print_layer_transfer(int layer, int load) {
    static const char letters[] = "pqct";
    int i, j, which;
    for (i = layer; i >= 0; i--)
        for (j = layer - i; j >= 0; j--)
            for (which = 0; which < 4; which++) {
                int k = layer - i - j, slot = 4 * index_in_layer(j, k) + which;
                if (which < 2 && !power_is_used(i, j, k)) continue;
                if (load) {
                    printf("        const dgfem_real ");
                    print_name(letters[which], i, j, k);
                    printf(" = m->layer[%d][l];\n", slot);
                } else {
                    printf("        m->layer[%d][l] = ", slot);
                    print_name(letters[which], i, j, k);
                    printf(";\n");
                }
            }
}

static void print_block(int first, int last, int degree) {
    int layer, i, j, v;
    printf("    /* degrees %d to %d */\n    for (l = 0; l < DGFEM_LANES; l++) {\n", first, last);
    for (v = 0; v < 4; v++) {
        char name = "abcd"[v];
        printf("        const dgfem_real %cx = m->corner[%d][l], %cy = m->corner[%d][l], %cz = m->corner[%d][l];\n",
               name, 3 * v, name, 3 * v + 1, name, 3 * v + 2);
    }
    print_multiples(first, last);
    if (first > 0) print_layer_transfer(first - 1, 1);
    for (layer = first; layer <= last; layer++)
        for (i = layer; i >= 0; i--)
            for (j = layer - i; j >= 0; j--) print_monomial(i, j, layer - i - j);
    if (last < degree) print_layer_transfer(last, 0);
    printf("    }\n");
    if (last < degree) printf("    if (m->degree <= %d) return;\n", last);
}

/* (i+j+k+extra)! / (i! j! k!), an integer: the product of the binomials n over i, n - i over j, n - i - j over k, and
   extra!, each built up so that every quotient is exact. */
static unsigned long long inverse_factor(int i, int j, int k, int extra) {
    unsigned long long value = 1;
    int e[3], axis, n, down = i + j + k + extra;
    e[0] = i, e[1] = j, e[2] = k;
    for (axis = 0; axis < 3; axis++)
        for (n = 1; n <= e[axis]; n++) value = value * (unsigned long long)down-- / (unsigned long long)n;
    for (; down > 1; down--) value *= (unsigned long long)down;
    return value;
}

static void print_factors(const char *name, const char *formula, int degree, int extra) {
    enum { PER_LINE = 5 };
    int layer, i, j, n = 0, count = count_up_to(degree);
    printf("/* %s */\n", formula);
    printf("static const dgfem_real %s[%d] = {\n", name, count);
    for (layer = 0; layer <= degree; layer++)
        for (i = layer; i >= 0; i--)
            for (j = layer - i; j >= 0; j--, n++) {
                printf(n % PER_LINE ? " " : "    ");
                printf("DGFEM_R(1.0 / %llu)", inverse_factor(i, j, layer - i - j, extra));
                printf(n == count - 1 ? "\n" : n % PER_LINE == PER_LINE - 1 ? ",\n" : ",");
            }
    printf("};\n\n");
}

/* The last factor 1/O, by the same recursion. */
static void print_apex(int degree) {
    int layer, i, j, axis;
    printf("/* The factor of the apex o, for the sum over all tetrahedra. */\n");
    printf("static void dgfemi_moments_apply_apex(int degree, dgfem_vec3 o, dgfem_real *total) {\n");
    for (layer = 1; layer <= degree; layer++) {
        printf("    if (degree < %d) return;\n", layer);
        for (i = layer; i >= 0; i--)
            for (j = layer - i; j >= 0; j--) {
                int k = layer - i - j, first = 1;
                printf("    total[%d] += ", monomial_index(i, j, k));
                for (axis = 0; axis < 3; axis++) {
                    int e[3];
                    e[0] = i, e[1] = j, e[2] = k;
                    if (e[axis]-- == 0) continue;
                    printf(first ? "o.%c * total[%d]" : " + o.%c * total[%d]", "xyz"[axis],
                           monomial_index(e[0], e[1], e[2]));
                    first = 0;
                }
                printf(";\n");
            }
    }
    printf("}\n\n");
}

/* Loops with constant bounds, layer by layer, need no run-time checks. */
static void print_finish(int degree) {
    int layer;
    printf("/* out[n] = total of sum[n] * factors[n] * scale * ratio^(degree of n) */\n");
    printf("static void dgfemi_moments_finish(const dgfemi_moments *m, const dgfem_real *factors, dgfem_real scale,\n"
           "                                  dgfem_real ratio, dgfem_real *out) {\n"
           "    dgfem_real total[DGFEM_MOMENTS_COUNT];\n"
           "    const int degree = m->degree;\n"
           "    int n;\n");
    for (layer = 0; layer <= degree; layer++) {
        printf(layer > 0 ? "    if (degree >= %d)\n        " : "    ", layer);
        printf("for (n = %d; n < %d; n++) total[n] = dgfemi_moments_lane_total(m->sum[n]);\n", count_up_to(layer - 1),
               count_up_to(layer));
    }
    printf("    if (!m->face) dgfemi_moments_apply_apex(degree, m->apex, total);\n");
    for (layer = 0; layer <= degree; layer++) {
        if (layer > 0) printf("    if (degree < %d) return;\n    scale *= ratio;\n", layer);
        printf("    for (n = %d; n < %d; n++) out[n] = total[n] * factors[n] * scale;\n", count_up_to(layer - 1),
               count_up_to(layer));
    }
    printf("}\n");
}

int main(int argc, char **argv) {
    int degree = argc == 2 ? atoi(argv[1]) : 0, first;
    if (degree < 1 || degree > MAX_DEGREE) {
        fprintf(stderr, "usage: moments_gen DEGREE (1..%d)\n", MAX_DEGREE);
        return 1;
    }
    printf("#pragma once\n");
    printf("/* Generated by src/gen/moments_gen.c: the integrals of all monomials up to degree %d. */\n\n", degree);
    printf("#define DGFEM_MOMENTS_DEGREE %d\n#define DGFEM_MOMENTS_COUNT %d\n", degree, count_up_to(degree));
    printf("#define DGFEM_MOMENTS_LAYER %d /* p, q, c, t of the largest layer that a block hands on */\n\n",
           2 * degree * (degree + 1));
    print_factors("dgfemi_volume_factors", "i! j! k! / (i+j+k+3)!", degree, 3);
    print_factors("dgfemi_face_factors", "i! j! k! / (i+j+k+2)!", degree, 2);
    printf(
        "/* Sums over pairs of triangles (a,b,c) and (a,c,d), lane by lane. moments.c has the functions that use it. "
        "*/\n"
        "typedef struct dgfemi_moments {\n"
        "    dgfem_real corner[12][DGFEM_LANES]; /* ax ay az bx .. dz, scaled; from the apex, then from the centre */\n"
        "    dgfem_real weight[2][DGFEM_LANES];  /* of (a,b,c) and of (a,c,d) */\n"
        "    dgfem_real layer[DGFEM_MOMENTS_LAYER][DGFEM_LANES];\n"
        "    dgfem_real sum[DGFEM_MOMENTS_COUNT][DGFEM_LANES];\n"
        "    const dgfem_vec3 *vertices;\n"
        "    dgfem_vec3 centre, normal;\n"
        "    dgfem_vec3 apex_position, apex; /* apex: from the centre, scaled */\n"
        "    dgfem_real scale, inverse_power;\n"
        "    int degree, face, lanes;\n"
        "    int apex_vertex; /* DGFEM_NONE before the first loop */\n"
        "    int waiting[3];  /* a triangle not yet in any pair; waiting[0] is DGFEM_NONE if there is none */\n"
        "} dgfemi_moments;\n\n");
    printf("/* sum[] += t of the pairs in corner[] with weight[], up to degree. The generator has the formulas. */\n");
    printf("static void dgfemi_moments_recursion(dgfemi_moments *m) {\n    int l;\n");
    for (first = 0; first <= degree;) {
        int last = block_end(first, degree);
        print_block(first, last, degree);
        first = last + 1;
    }
    printf("}\n\n");
    print_apex(degree);
    print_finish(degree);
    return 0;
}

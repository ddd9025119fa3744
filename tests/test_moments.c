/* Moments of polyhedra and of their faces against exact rational arithmetic and closed forms. */
#define DGFEM_IMPLEMENTATION
#include "dgfem.h"

#include "check.h"
#include "shapes.h"

#include <gmp.h>

enum { DEGREE = DGFEM_MAX_MOMENT_DEGREE, COUNT = 84 };

/* The bound that the manual gives, 1e-14 h^d V in double, in units of the precision under test. */
static const double bound = 1e-14 / 2.220446049250313e-16 * CHECK_EPSILON;

/* One shape, its size changed by the tests, lives here. */
static shape s, scratch;

static double factorial(int n) { return n < 2 ? 1 : n * factorial(n - 1); }

static double reach_of(const shape *solid, dgfem_vec3 centre) {
    double reach = 0;
    int v;
    for (v = 0; v < solid->vertex_count; v++) {
        const dgfem_vec3 p = solid->vertices[v];
        const double x = (double)(p.x - centre.x), y = (double)(p.y - centre.y), z = (double)(p.z - centre.z);
        reach = fmax(reach, sqrt(x * x + y * y + z * z));
    }
    return reach;
}

/* ---- the oracle: coordinates as integers (multiples of 2^-FRACTION), multinomial theorem over each tetrahedron ----

   With x = sum_v l_v x_v over the corners v of the simplex (0, v1, v2, v3), l the barycentric coordinates,
     integral of l_1^p l_2^q l_3^r = D p! q! r! / (p + q + r + 3)!,   D = det(v1, v2, v3);  3 becomes 2 for a triangle.
   Terms are summed without the common denominator 2^(FRACTION (d + 3)) (d + 3)!. */

enum { FRACTION = 44 };

typedef struct oracle {
    mpz_t points[3][3]; /* corners, coordinates */
    mpz_t terms[3][DEGREE + 1][DEGREE + 1]
               [DEGREE + 1]; /* axis, e, p, q: term l_1^p l_2^q l_3^(e-p-q) of its e-th power */
    mpz_t sums[COUNT];
    mpz_t determinant, with_x, with_y, term, product;
    unsigned long factorials[DEGREE + 1];
} oracle;

static void oracle_for_each_term(oracle *o, void (*fn)(mpz_t)) {
    int axis, e, p, q;
    for (axis = 0; axis < 3; axis++)
        for (e = 0; e <= DEGREE; e++)
            for (p = 0; p <= e; p++)
                for (q = 0; p + q <= e; q++) fn(o->terms[axis][e][p][q]);
}

static void oracle_begin(oracle *o) {
    int i, axis;
    for (i = 0; i < 3; i++)
        for (axis = 0; axis < 3; axis++) mpz_init(o->points[i][axis]);
    oracle_for_each_term(o, mpz_init);
    for (i = 0; i < COUNT; i++) mpz_init(o->sums[i]);
    mpz_inits(o->determinant, o->with_x, o->with_y, o->term, o->product, NULL);
    for (i = 0; i <= DEGREE; i++) o->factorials[i] = (unsigned long)factorial(i);
}

static void oracle_end(oracle *o) {
    int i, axis;
    for (i = 0; i < 3; i++)
        for (axis = 0; axis < 3; axis++) mpz_clear(o->points[i][axis]);
    oracle_for_each_term(o, mpz_clear);
    for (i = 0; i < COUNT; i++) mpz_clear(o->sums[i]);
    mpz_clears(o->determinant, o->with_x, o->with_y, o->term, o->product, NULL);
}

/* The exact difference of two numbers, which must be a multiple of 2^-FRACTION. */
static void exact_difference(mpz_t out, double a, double b) {
    mpz_t t;
    assert_true(ldexp(a, FRACTION) == floor(ldexp(a, FRACTION)) && ldexp(b, FRACTION) == floor(ldexp(b, FRACTION)));
    mpz_init(t);
    mpz_set_d(out, ldexp(a, FRACTION));
    mpz_set_d(t, ldexp(b, FRACTION));
    mpz_sub(out, out, t);
    mpz_clear(t);
}

static void oracle_set_point(oracle *o, int corner, dgfem_vec3 p, dgfem_vec3 centre) {
    exact_difference(o->points[corner][0], (double)p.x, (double)centre.x);
    exact_difference(o->points[corner][1], (double)p.y, (double)centre.y);
    exact_difference(o->points[corner][2], (double)p.z, (double)centre.z);
}

/* The multinomial theorem: e! / (p! q! r!) x_1^p x_2^q x_3^r. */
static void oracle_set_terms(oracle *o) {
    int axis, e, p, q;
    for (axis = 0; axis < 3; axis++)
        for (e = 0; e <= DEGREE; e++)
            for (p = 0; p <= e; p++)
                for (q = 0; p + q <= e; q++) {
                    mpz_t *term = &o->terms[axis][e][p][q];
                    const int r = e - p - q;
                    mpz_pow_ui(*term, o->points[0][axis], (unsigned long)p);
                    mpz_pow_ui(o->product, o->points[1][axis], (unsigned long)q);
                    mpz_mul(*term, *term, o->product);
                    mpz_pow_ui(o->product, o->points[2][axis], (unsigned long)r);
                    mpz_mul(*term, *term, o->product);
                    mpz_mul_ui(*term, *term,
                               o->factorials[e] / (o->factorials[p] * o->factorials[q] * o->factorials[r]));
                }
}

/* Adds determinant * (integral of x^i y^j z^k), times (d + 3)! or (d + 2)!. */
static void oracle_add_monomial(oracle *o, int i, int j, int k) {
    mpz_t *sum = &o->sums[dgfem_monomial_index(i, j, k)];
    int pi, qi, pj, qj, pk, qk;
    for (pi = 0; pi <= i; pi++)
        for (qi = 0; pi + qi <= i; qi++) {
            mpz_mul(o->with_x, o->determinant, o->terms[0][i][pi][qi]);
            for (pj = 0; pj <= j; pj++)
                for (qj = 0; pj + qj <= j; qj++) {
                    mpz_mul(o->with_y, o->with_x, o->terms[1][j][pj][qj]);
                    for (pk = 0; pk <= k; pk++)
                        for (qk = 0; pk + qk <= k; qk++) {
                            const int p = pi + pj + pk, q = qi + qj + qk, r = i + j + k - p - q;
                            mpz_mul(o->term, o->with_y, o->terms[2][k][pk][qk]);
                            mpz_addmul_ui(*sum, o->term, o->factorials[p] * o->factorials[q] * o->factorials[r]);
                        }
                }
        }
}

static void oracle_add_simplex(oracle *o) {
    int d, i, j;
    if (mpz_sgn(o->determinant) == 0) return;
    oracle_set_terms(o);
    for (d = 0; d <= DEGREE; d++)
        for (i = 0; i <= d; i++)
            for (j = 0; i + j <= d; j++) oracle_add_monomial(o, i, j, d - i - j);
}

/* component[axis] of a x b */
static void oracle_cross(oracle *o, mpz_t out, mpz_t a[3], mpz_t b[3], int axis) {
    mpz_mul(out, a[(axis + 1) % 3], b[(axis + 2) % 3]);
    mpz_mul(o->product, a[(axis + 2) % 3], b[(axis + 1) % 3]);
    mpz_sub(out, out, o->product);
}

/* The exact value, of which `scale` powers of 2^-FRACTION and the denominator are left, minus a number. */
static double oracle_off(oracle *o, int n, int scale, int denominator, double computed) {
    mpq_t exact, number;
    double off;
    mpq_inits(exact, number, NULL);
    mpq_set_z(exact, o->sums[n]);
    mpz_fac_ui(o->term, (unsigned long)denominator);
    mpq_set_z(number, o->term);
    mpq_div(exact, exact, number);
    mpq_div_2exp(exact, exact, (mp_bitcnt_t)(FRACTION * scale));
    if (!isfinite(computed)) {
        off = (double)NAN;
    } else {
        mpq_set_d(number, computed);
        mpq_sub(number, number, exact);
        off = mpq_get_d(number);
    }
    mpq_clears(exact, number, NULL);
    return fabs(off);
}

/* The fan of each loop from its last vertex: other triangles than those of the library. */
static void oracle_volume(oracle *o, const shape *solid, dgfem_vec3 centre) {
    int l, i, axis;
    mpz_t minor;
    mpz_init(minor);
    for (l = 0; l < solid->loop_count; l++) {
        const int start = solid->loop_start[l], last = solid->loop_start[l + 1] - 1;
        for (i = start; i + 1 < last; i++) {
            oracle_set_point(o, 0, solid->vertices[solid->loop_vertices[last]], centre);
            oracle_set_point(o, 1, solid->vertices[solid->loop_vertices[i]], centre);
            oracle_set_point(o, 2, solid->vertices[solid->loop_vertices[i + 1]], centre);
            mpz_set_ui(o->determinant, 0);
            for (axis = 0; axis < 3; axis++) {
                oracle_cross(o, minor, o->points[1], o->points[2], axis);
                mpz_mul(minor, minor, o->points[0][axis]);
                mpz_add(o->determinant, o->determinant, minor);
            }
            oracle_add_simplex(o);
        }
    }
    mpz_clear(minor);
}

/* Component `axis` of the integrals of monomial * unit normal over one face. */
static void oracle_face(oracle *o, const shape *solid, int face, dgfem_vec3 centre, int axis) {
    mpz_t u[3], w[3];
    int l, i, k;
    for (k = 0; k < 3; k++) mpz_inits(u[k], w[k], NULL);
    for (l = solid->face_loops[face]; l < solid->face_loops[face + 1]; l++) {
        const int start = solid->loop_start[l], last = solid->loop_start[l + 1] - 1;
        for (i = start; i + 1 < last; i++) {
            oracle_set_point(o, 0, solid->vertices[solid->loop_vertices[last]], centre);
            oracle_set_point(o, 1, solid->vertices[solid->loop_vertices[i]], centre);
            oracle_set_point(o, 2, solid->vertices[solid->loop_vertices[i + 1]], centre);
            for (k = 0; k < 3; k++) {
                mpz_sub(u[k], o->points[1][k], o->points[0][k]);
                mpz_sub(w[k], o->points[2][k], o->points[0][k]);
            }
            oracle_cross(o, o->determinant, u, w, axis);
            oracle_add_simplex(o);
        }
    }
    for (k = 0; k < 3; k++) mpz_clears(u[k], w[k], NULL);
}

/* ---- comparisons with the oracle ---- */

/* The largest error of any moment in units of h^d V. */
static double volume_error(const shape *solid, dgfem_vec3 centre) {
    dgfem_polyhedron *polyhedron = shape_polyhedron(solid);
    const double h = reach_of(solid, centre);
    dgfem_real moments[COUNT];
    double worst = 0, volume;
    oracle o;
    int d, n = 0;
    check_status(dgfem_polyhedron_moments(polyhedron, DEGREE, centre, moments), DGFEM_OK);
    volume = (double)moments[0];
    assert_true(volume > 0);
    oracle_begin(&o);
    oracle_volume(&o, solid, centre);
    for (d = 0; d <= DEGREE; d++)
        for (; n < dgfem_monomial_count(d); n++) {
            const double off = oracle_off(&o, n, d + 3, d + 3, (double)moments[n]) / (pow(h, d) * volume);
            if (!(off <= worst)) worst = off;
        }
    oracle_end(&o);
    dgfem_polyhedron_destroy(polyhedron);
    return worst;
}

/* The largest error of any moment of any face in units of h^d times the largest face's area. */
static double face_error(const shape *solid, dgfem_vec3 centre) {
    dgfem_polyhedron *polyhedron = shape_polyhedron(solid);
    const double h = reach_of(solid, centre);
    dgfem_real moments[COUNT];
    double worst = 0, largest = 0;
    int f, axis, d;
    for (f = 0; f < solid->face_count; f++) {
        check_status(dgfem_polyhedron_face_moments(polyhedron, f, 0, centre, moments), DGFEM_OK);
        largest = fmax(largest, (double)moments[0]);
    }
    for (f = 0; f < solid->face_count; f++) {
        const dgfem_vec3 normal = dgfemi_normalized(dgfemi_polyhedron_vector_area(polyhedron, f));
        check_status(dgfem_polyhedron_face_moments(polyhedron, f, DEGREE, centre, moments), DGFEM_OK);
        assert_true(moments[0] > 0);
        for (axis = 0; axis < 3; axis++) {
            oracle o;
            int n = 0;
            oracle_begin(&o);
            oracle_face(&o, solid, f, centre, axis);
            for (d = 0; d <= DEGREE; d++)
                for (; n < dgfem_monomial_count(d); n++) {
                    const double value = (double)moments[n] * (double)dgfemi_axis(normal, axis);
                    const double off = oracle_off(&o, n, d + 2, d + 2, value) / (pow(h, d) * largest);
                    if (!(off <= worst)) worst = off;
                }
            oracle_end(&o);
        }
    }
    dgfem_polyhedron_destroy(polyhedron);
    return worst;
}

/* ---- shapes with exactly planar faces in any position ---- */

enum { KINDS = 9 };
static const char *const kind_names[KINDS] = {
    "tetrahedron", "box", "cut cube", "truncated octahedron", "star prism", "plate", "bracket", "hollow box", "torus"};

static void make_kind(int kind) {
    if (kind == 0) shape_tetrahedron(&s);
    if (kind == 1) shape_box(&s, -1, -2, 0, 3, 1, 2);
    if (kind == 2) shape_cut_cube(&s);
    if (kind == 3) shape_truncated_octahedron(&s);
    if (kind == 4) shape_star_prism(&s);
    if (kind == 5) shape_plate(&s);
    if (kind == 6) shape_bracket(&s);
    if (kind == 7) shape_hollow_box(&s, &scratch);
    if (kind == 8) shape_torus(&s, 10, 10);
}

/* What a number can hold exactly: in double 2^-20 next to 2^20 (about 1e-6 and 1e6), in float much less. */
static double flat(void) { return DGFEM_REAL_IS_FLOAT ? 0x1p-6 : 0x1p-20; }
static double far_away(void) { return DGFEM_REAL_IS_FLOAT ? 0x1p9 : 0x1p20; }

/* Random columns of so few digits that images of lattice points are exact and planes stay planes, but of so many that
   products of three coordinates are not. */
static void random_directions(check_random *random, double m[3][3]) {
    const int digits = DGFEM_REAL_IS_FLOAT ? 1 << 3 : 1 << 12;
    double determinant;
    int i, k;
    do {
        for (i = 0; i < 3; i++)
            for (k = 0; k < 3; k++)
                m[i][k] = k < 2 ? (double)(check_random_int(random, 2 * digits + 1) - digits) / digits
                                : check_random_int(random, 5) - 2;
        determinant = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                      m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                      m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    } while (determinant < 0.5);
}

/* Flattened along z, then turned and sheared, then moved. */
static void place(check_random *random, double thickness, int oblique, double offset, dgfem_vec3 *centre) {
    double m[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, t[3], mean[3] = {0, 0, 0};
    int i, k, v;
    if (oblique) random_directions(random, m);
    for (i = 0; i < 3; i++) m[i][2] *= thickness;
    for (k = 0; k < 3; k++) t[k] = offset * (check_random_int(random, 2) ? 1 : -1);
    shape_transform(&s, (const double(*)[3])m, t);
    for (v = 0; v < s.vertex_count; v++) {
        mean[0] += ((double)s.vertices[v].x - t[0]) / s.vertex_count;
        mean[1] += ((double)s.vertices[v].y - t[1]) / s.vertex_count;
        mean[2] += ((double)s.vertices[v].z - t[2]) / s.vertex_count;
    }
    for (i = 0; i < 3; i++) mean[i] = floor(mean[i] / flat()) * flat() + t[i]; /* so that differences to it are exact */
    centre->x = (dgfem_real)mean[0], centre->y = (dgfem_real)mean[1], centre->z = (dgfem_real)mean[2];
}

static void check_error(const char *what, const char *where, double error) {
    print_message("%-22s %-32s %.2e h^d V\n", what, where, error);
    if (error <= bound) return;
    print_error("%s, %s: error %g exceeds %g\n", what, where, error, bound);
    fail();
}

static void volume_moments_of_shapes(void **state) {
    static const char *const places[5] = {"at the origin", "far away", "flat", "flat, far away",
                                          "flat, oblique, far away"};
    check_random random = check_random_seeded(1);
    int kind, at;
    (void)state;
    for (kind = 0; kind < KINDS; kind++)
        for (at = 0; at < 5; at++) {
            dgfem_vec3 centre;
            make_kind(kind);
            place(&random, at >= 2 ? flat() : 1, at == 4, at == 0 || at == 2 ? 0 : far_away(), &centre);
            check_error(kind_names[kind], places[at], volume_error(&s, centre));
        }
}

/* ---- random polyhedra ---- */

/* A star-shaped polygon on the lattice of step 1/4 about the origin, outside radius 4, with a square hole or none. */
static void random_prism(check_random *random, int hole) {
    double xy[64];
    int loops[3] = {0, 0, 0}, n = 5 + check_random_int(random, 12), i;
    for (i = 0; i < n; i++) {
        const double radius = check_random_real(random, 4.5, 9), angle = 2 * 3.14159265358979324 * i / n;
        xy[2 * i] = floor(radius * cos(angle) * 4 + 0.5) / 4;
        xy[2 * i + 1] = floor(radius * sin(angle) * 4 + 0.5) / 4;
    }
    loops[1] = n, loops[2] = n + 4;
    for (i = 0; i < 4; i++) {
        xy[2 * (n + i)] = i == 0 || i == 1 ? -1 : 1;
        xy[2 * (n + i) + 1] = i == 1 || i == 2 ? 1 : -1;
    }
    shape_prism(&s, xy, loops, hole ? 2 : 1, -3, 2);
}

/* Triangles over a grid of directions, the radius random: not convex, star-shaped. */
static void random_star(check_random *random, int rings, int sides) {
    int i, k, south;
    shape_begin(&s);
    shape_vertex(&s, 0, 0, 8);
    for (i = 1; i < rings; i++)
        for (k = 0; k < sides; k++) {
            const double a = 3.14159265358979324 * i / rings, b = 2 * 3.14159265358979324 * k / sides;
            const double r = check_random_real(random, 3, 9);
            shape_vertex(&s, floor(r * sin(a) * cos(b) * 4 + 0.5) / 4, floor(r * sin(a) * sin(b) * 4 + 0.5) / 4,
                         floor(r * cos(a) * 4 + 0.5) / 4);
        }
    south = shape_vertex(&s, 0, 0, -8);
    for (k = 0; k < sides; k++) {
        const int next = (k + 1) % sides;
        shape_triangle(&s, 0, 1 + k, 1 + next);
        for (i = 0; i + 2 < rings; i++) {
            const int a = 1 + i * sides + k, b = 1 + (i + 1) * sides + k, c = 1 + (i + 1) * sides + next;
            const int d = 1 + i * sides + next;
            shape_triangle(&s, a, b, c);
            shape_triangle(&s, a, c, d);
        }
        shape_triangle(&s, 1 + (rings - 2) * sides + k, south, 1 + (rings - 2) * sides + next);
    }
}

/* Four random lattice points. */
static void random_tetrahedron(check_random *random) {
    static const double identity[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const double origin[3] = {0, 0, 0};
    double volume;
    int v;
    do {
        shape_tetrahedron(&s);
        shape_transform(&s, identity, origin);
        for (v = 0; v < 4; v++) {
            s.vertices[v].x = (dgfem_real)(check_random_int(random, 65) - 32) / 4;
            s.vertices[v].y = (dgfem_real)(check_random_int(random, 65) - 32) / 4;
            s.vertices[v].z = (dgfem_real)(check_random_int(random, 65) - 32) / 4;
        }
        volume = (double)dgfemi_triple_product(dgfemi_sub(s.vertices[1], s.vertices[0]),
                                               dgfemi_sub(s.vertices[2], s.vertices[0]),
                                               dgfemi_sub(s.vertices[3], s.vertices[0]));
    } while (fabs(volume) < 8);
    if (volume < 0) shape_reverse(&s);
}

static void volume_moments_of_random_polyhedra(void **state) {
    check_random random = check_random_seeded(2);
    const int rounds = check_long() ? 400 : 12;
    double worst = 0;
    int round;
    (void)state;
    for (round = 0; round < rounds; round++) {
        static const char *const names[4] = {"random tetrahedron", "random prism", "random prism with hole",
                                             "random star"};
        const int kind = round % 4;
        dgfem_vec3 centre;
        double error;
        if (kind == 0) random_tetrahedron(&random);
        if (kind == 1 || kind == 2) random_prism(&random, kind == 2);
        if (kind == 3) random_star(&random, 3 + check_random_int(&random, 4), 3 + check_random_int(&random, 5));
        place(&random, flat(), round % 3 != 0, far_away(), &centre);
        error = volume_error(&s, centre);
        if (!check_long()) check_error(names[kind], "flat, far away", error);
        if (!(error <= worst)) worst = error;
    }
    check_error("worst", "of all", worst);
}

static void face_moments_of_shapes(void **state) {
    check_random random = check_random_seeded(3);
    int kind, at;
    (void)state;
    for (kind = 0; kind < 8; kind++)
        for (at = 0; at < 3; at++) {
            static const char *const places[3] = {"faces at the origin", "faces, oblique, far away", "faces, flat"};
            dgfem_vec3 centre;
            make_kind(kind);
            place(&random, at == 2 ? flat() : 1, at == 1, at == 1 ? far_away() : 0, &centre);
            check_error(kind_names[kind], places[at], face_error(&s, centre));
        }
}

/* ---- closed forms ---- */

static void box_and_tetrahedron_in_closed_form(void **state) {
    dgfem_polyhedron *box, *tetrahedron;
    dgfem_real moments[COUNT];
    int d, i, j;
    (void)state;
    shape_box(&s, 0, 0, 0, 1, 1, 1);
    box = shape_polyhedron(&s);
    shape_tetrahedron(&s);
    tetrahedron = shape_polyhedron(&s);
    check_status(dgfem_polyhedron_moments(box, DEGREE, dgfemi_vec3(0, 0, 0), moments), DGFEM_OK);
    for (d = 0; d <= DEGREE; d++)
        for (i = 0; i <= d; i++)
            for (j = 0; i + j <= d; j++)
                check_near(moments[dgfem_monomial_index(i, j, d - i - j)], 1.0 / ((i + 1) * (j + 1) * (d - i - j + 1)),
                           4 * CHECK_EPSILON);
    check_status(dgfem_polyhedron_moments(tetrahedron, DEGREE, dgfemi_vec3(0, 0, 0), moments), DGFEM_OK);
    for (d = 0; d <= DEGREE; d++)
        for (i = 0; i <= d; i++)
            for (j = 0; i + j <= d; j++)
                check_near(moments[dgfem_monomial_index(i, j, d - i - j)],
                           factorial(i) * factorial(j) * factorial(d - i - j) / factorial(d + 3), CHECK_EPSILON);
    dgfem_polyhedron_destroy(box);
    dgfem_polyhedron_destroy(tetrahedron);
}

/* The face z = 0 of the tetrahedron: i! j! / (i + j + 2)!, and nothing with z in it. */
static void triangle_in_closed_form(void **state) {
    dgfem_polyhedron *tetrahedron;
    dgfem_real moments[COUNT];
    int d, i, j;
    (void)state;
    shape_tetrahedron(&s);
    tetrahedron = shape_polyhedron(&s);
    check_status(dgfem_polyhedron_face_moments(tetrahedron, 0, DEGREE, dgfemi_vec3(0, 0, 0), moments), DGFEM_OK);
    for (d = 0; d <= DEGREE; d++)
        for (i = 0; i <= d; i++)
            for (j = 0; i + j <= d; j++)
                check_near(moments[dgfem_monomial_index(i, j, d - i - j)],
                           i + j < d ? 0 : factorial(i) * factorial(j) / factorial(d + 2), CHECK_EPSILON);
    dgfem_polyhedron_destroy(tetrahedron);
}

/* ---- properties ---- */

static void monomials_are_ordered(void **state) {
    int d, i, j, n = 0;
    (void)state;
    for (d = 0; d <= 8; d++)
        for (i = d; i >= 0; i--)
            for (j = d - i; j >= 0; j--) assert_int_equal(dgfem_monomial_index(i, j, d - i - j), n++);
    assert_int_equal(dgfem_monomial_count(-1), 0);
    assert_int_equal(dgfem_monomial_count(0), 1);
    assert_int_equal(dgfem_monomial_count(1), 4);
    assert_int_equal(dgfem_monomial_count(2), 10);
    assert_int_equal(dgfem_monomial_count(4), 35);
    assert_int_equal(dgfem_monomial_count(6), COUNT);
    assert_int_equal(DGFEM_MOMENTS_DEGREE, DGFEM_MAX_MOMENT_DEGREE);
}

/* (3 + d) * volume moment = sum over the faces of distance(face, centre) * face moment, for a monomial of degree d. */
static void volume_and_faces_agree(void **state) {
    check_random random = check_random_seeded(4);
    int kind, d;
    (void)state;
    for (kind = 0; kind < KINDS; kind++) {
        dgfem_polyhedron *polyhedron;
        dgfem_real volume[COUNT], face[COUNT];
        double sum[COUNT] = {0}, size[COUNT] = {0}, h;
        dgfem_vec3 centre;
        int f, n = 0;
        make_kind(kind);
        place(&random, 1, 1, 0, &centre);
        h = reach_of(&s, centre);
        polyhedron = shape_polyhedron(&s);
        check_status(dgfem_polyhedron_moments(polyhedron, DEGREE, centre, volume), DGFEM_OK);
        for (f = 0; f < s.face_count; f++) {
            const dgfem_vec3 normal = dgfemi_normalized(dgfemi_polyhedron_vector_area(polyhedron, f));
            const dgfem_vec3 p = s.vertices[s.loop_vertices[s.loop_start[s.face_loops[f]]]];
            const double distance = (double)dgfemi_dot(normal, dgfemi_sub(p, centre));
            check_status(dgfem_polyhedron_face_moments(polyhedron, f, DEGREE, centre, face), DGFEM_OK);
            for (n = 0; n < COUNT; n++)
                sum[n] += distance * (double)face[n], size[n] += fabs(distance * (double)face[0]);
        }
        for (n = 0, d = 0; d <= DEGREE; d++)
            for (; n < dgfem_monomial_count(d); n++)
                check_near(sum[n], (3 + d) * (double)volume[n], 8 * CHECK_EPSILON * size[n] * pow(h, d));
        dgfem_polyhedron_destroy(polyhedron);
    }
}

/* A lower degree gives the same numbers, and writes no more of them. */
static void lower_degrees_agree(void **state) {
    dgfem_polyhedron *polyhedron;
    const dgfem_vec3 centre = dgfemi_vec3(1, 2, 3);
    dgfem_real all[COUNT], some[COUNT + 1];
    int degree, n, face;
    (void)state;
    shape_plate(&s);
    polyhedron = shape_polyhedron(&s);
    for (face = 0; face < 2; face++) {
        check_status(face ? dgfem_polyhedron_face_moments(polyhedron, 1, DEGREE, centre, all)
                          : dgfem_polyhedron_moments(polyhedron, DEGREE, centre, all),
                     DGFEM_OK);
        for (degree = 0; degree <= DEGREE; degree++) {
            const int count = dgfem_monomial_count(degree);
            for (n = 0; n <= COUNT; n++) some[n] = 12345;
            check_status(face ? dgfem_polyhedron_face_moments(polyhedron, 1, degree, centre, some)
                              : dgfem_polyhedron_moments(polyhedron, degree, centre, some),
                         DGFEM_OK);
            for (n = 0; n < count; n++) check_near(some[n], all[n], 4 * CHECK_EPSILON * fabs((double)all[n]));
            for (; n <= COUNT; n++) assert_true(some[n] == 12345);
        }
    }
    dgfem_polyhedron_destroy(polyhedron);
}

/* Any length scale gives the moments divided by h^d; reversed loops the opposite sign. */
static void scaled_and_reversed(void **state) {
    static const double scales[4] = {0.3, 1, 7, 1e-3};
    const dgfem_vec3 centre = dgfemi_vec3(DGFEM_R(1.5), DGFEM_R(1.0), DGFEM_R(0.25));
    dgfem_polyhedron *polyhedron;
    dgfem_real plain[COUNT], scaled[COUNT];
    double h;
    int k, reverse, d, l;
    (void)state;
    shape_bracket(&s);
    h = reach_of(&s, centre);
    polyhedron = shape_polyhedron(&s);
    check_status(dgfem_polyhedron_moments(polyhedron, DEGREE, centre, plain), DGFEM_OK);
    for (k = 0; k < 4; k++)
        for (reverse = 0; reverse < 2; reverse++) {
            dgfemi_moments moments;
            int n = 0;
            dgfemi_moments_begin_volume(&moments, DEGREE, centre, (dgfem_real)scales[k]);
            for (l = 0; l < s.loop_count; l++)
                dgfemi_moments_loop(&moments, s.vertices, s.loop_vertices + s.loop_start[l],
                                    s.loop_start[l + 1] - s.loop_start[l], reverse);
            dgfemi_moments_end(&moments, scaled);
            for (d = 0; d <= DEGREE; d++)
                for (; n < dgfem_monomial_count(d); n++)
                    check_near((double)scaled[n] * pow((double)(dgfem_real)scales[k], d) * (reverse ? -1 : 1), plain[n],
                               bound * pow(h, d) * (double)plain[0]);
        }
    dgfem_polyhedron_destroy(polyhedron);
}

/* Powers of a large and of a small length stay within the range of float as long as they are scaled. */
static void extreme_sizes(void **state) {
    static const double sizes[2] = {1e8, 1e-8};
    int k, d;
    (void)state;
    for (k = 0; k < 2; k++) {
        const dgfem_real size = (dgfem_real)sizes[k];
        dgfem_real scaled[COUNT];
        dgfemi_moments moments;
        int l, n = 0;
        shape_box(&s, 0, 0, 0, (double)size, (double)size, (double)size);
        dgfemi_moments_begin_volume(&moments, DEGREE, dgfemi_vec3(0, 0, 0), size);
        for (l = 0; l < s.loop_count; l++)
            dgfemi_moments_loop(&moments, s.vertices, s.loop_vertices + s.loop_start[l], 4, 0);
        dgfemi_moments_end(&moments, scaled);
        for (d = 0; d <= DEGREE; d++) {
            const double volume = pow((double)size, 3);
            check_near(scaled[n], volume / (d + 1), 8 * CHECK_EPSILON * volume); /* x^d */
            n = dgfem_monomial_count(d);
        }
    }
}

/* ---- arguments ---- */

static void bad_calls(void **state) {
    const dgfem_vec3 origin = dgfemi_vec3(0, 0, 0), nowhere = dgfemi_vec3(0, (dgfem_real)NAN, 0);
    dgfem_polyhedron_desc desc;
    dgfem_polyhedron *polyhedron;
    dgfem_real out[COUNT];
    check_host host;
    (void)state;
    shape_tetrahedron(&s);
    desc = shape_desc(&s);
    desc.hooks = check_hooks(&host);
    check_status(dgfem_polyhedron_create(&desc, &polyhedron), DGFEM_OK);
    check_status(dgfem_polyhedron_moments(NULL, 2, origin, out), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_face_moments(NULL, 0, 2, origin, out), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_polyhedron_moments(polyhedron, 2, origin, NULL), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "nowhere");
    check_status(dgfem_polyhedron_moments(polyhedron, -1, origin, out), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "degree -1");
    check_status(dgfem_polyhedron_moments(polyhedron, 7, origin, out), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "degree 7");
    check_status(dgfem_polyhedron_moments(polyhedron, 2, nowhere, out), DGFEM_ERROR_NOT_FINITE);
    check_logged(&host, "centre");
    check_status(dgfem_polyhedron_face_moments(polyhedron, 4, 2, origin, out), DGFEM_ERROR_INDEX);
    check_logged(&host, "face 4 of 4");
    check_status(dgfem_polyhedron_face_moments(polyhedron, -1, 2, origin, out), DGFEM_ERROR_INDEX);
    check_logged(&host, "face -1 of 4");
    check_status(dgfem_polyhedron_face_moments(polyhedron, 0, 9, origin, out), DGFEM_ERROR_ARGUMENT);
    check_logged(&host, "degree 9");
    dgfem_polyhedron_destroy(polyhedron);
    assert_int_equal(host.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(monomials_are_ordered),
        cmocka_unit_test(box_and_tetrahedron_in_closed_form),
        cmocka_unit_test(triangle_in_closed_form),
        cmocka_unit_test(volume_moments_of_shapes),
        cmocka_unit_test(volume_moments_of_random_polyhedra),
        cmocka_unit_test(face_moments_of_shapes),
        cmocka_unit_test(volume_and_faces_agree),
        cmocka_unit_test(lower_degrees_agree),
        cmocka_unit_test(scaled_and_reversed),
        cmocka_unit_test(extreme_sizes),
        cmocka_unit_test(bad_calls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

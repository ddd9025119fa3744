/* Mean value coordinates and the elements made of them. */
#define DGFEM_IMPLEMENTATION
#include "dgfem_mvc.h"
#include "check_mvc.h"
#include "mvc_reference.h"

/* ---- coordinates ---- */

enum { MAX_NODES = 128 };

/* A cell with storage of its own. */
typedef struct sample_cell {
    dgfem_vec3 nodes[MAX_NODES];
    int triangles[3 * 2 * MAX_NODES];
    dgfem_mvc_cell cell;
} sample_cell;

static void bind_cell(sample_cell *s, int nodes, int triangles) {
    s->cell.nodes = s->nodes, s->cell.node_count = nodes;
    s->cell.triangles = s->triangles, s->cell.triangle_count = triangles;
}

static void take_reference(sample_cell *s, const mvc_reference *r) {
    for (int i = 0; i < r->node_count; i++) s->nodes[i] = vec3(r->nodes[i][0], r->nodes[i][1], r->nodes[i][2]);
    for (int i = 0; i < 3 * r->triangle_count; i++) s->triangles[i] = r->triangles[i / 3][i % 3];
    bind_cell(s, r->node_count, r->triangle_count);
}

/* An element of a body. */
static void take_element(sample_cell *s, const dgfem_mvc *body, int e) {
    int nodes[MAX_NODES], faces[MAX_NODES], loop[3 * MAX_NODES], count = 0;
    int n = dgfem_mvc_element_nodes(body, e, nodes, MAX_NODES);
    int m = dgfem_mvc_element_faces(body, e, faces, MAX_NODES);
    assert_in_range(n, 4, MAX_NODES);
    for (int i = 0; i < n; i++) s->nodes[i] = body->rest[nodes[i]];
    for (int k = 0; k < m; k++) {
        int owners[2], triangles = dgfem_mvc_face_triangles(body, faces[k], loop, MAX_NODES);
        dgfem_mvc_face_elements(body, faces[k], owners);
        for (int i = 0; i < 3 * triangles; i++) {
            int at = 0, from = owners[0] == e ? i : i - i % 3 + 2 - i % 3;
            while (nodes[at] != loop[from]) at++;
            s->triangles[3 * count + i] = at;
        }
        count += triangles;
    }
    assert_int_equal(count, 2 * n - 4);
    bind_cell(s, n, count);
}

static double size_of(const dgfem_mvc_cell *cell) {
    double size = 0;
    for (int i = 0; i < cell->node_count; i++) size = fmax(size, check_distance(cell->nodes[i], cell->nodes[0]));
    return size;
}

/* Values and gradients against 50 digits. Errors of gradients are relative to the largest gradient of the cell's
   nodes: in cells of thickness h they are as large as 1 / h across, and their parts along the cell differ by that
   much less. */
static void test_reference(void **state) {
    (void)state;
    for (int r = 0; r < 5; r++) {
        const mvc_reference *reference = &mvc_references[r];
        sample_cell s;
        double worst = 0, worst_slope = 0;
        if (DGFEM_REAL_IS_FLOAT && r == 3) continue; /* in float, points of so thin a slab are on its surface */
        take_reference(&s, reference);
        for (int p = 0; p < 4; p++) {
            dgfem_real values[24];
            dgfem_vec3 slopes[24];
            const double *x = reference->points[p];
            double largest = 0;
            check_status(dgfem_mvc_coordinates(&s.cell, vec3(x[0], x[1], x[2]), values, slopes), DGFEM_OK);
            for (int k = 0; k < 3 * s.cell.node_count; k++)
                largest = fmax(largest, fabs(reference->values[p][k / 3][1 + k % 3]));
            for (int k = 0; k < s.cell.node_count; k++) {
                const double *exact = reference->values[p][k];
                double error = check_distance(slopes[k], vec3(exact[1], exact[2], exact[3])) / largest;
                worst = fmax(worst, fabs((double)values[k] - exact[0]));
                worst_slope = fmax(worst_slope, error);
                check_near(values[k], exact[0], 5 * CHECK_EPSILON);
                check_near(error, 0, 500 * CHECK_EPSILON);
            }
        }
        print_message("%s: values to %.1e, gradients to %.1e\n", reference->name, worst, worst_slope);
    }
}

/* Sums of values and gradients: 1, x, 0, I. In thin cells gradients are large, and their sums have errors to match. */
static void check_sums(const dgfem_mvc_cell *cell, dgfem_vec3 x, const dgfem_real *values, const dgfem_vec3 *slopes,
                       double factor) {
    double one = 0, at[3] = {0, 0, 0}, sum[3] = {0, 0, 0}, outer[3][3], size = size_of(cell), largest = 0;
    memset(outer, 0, sizeof outer);
    for (int k = 0; k < cell->node_count; k++) {
        double g[3], p[3];
        p[0] = (double)cell->nodes[k].x - (double)x.x, p[1] = (double)cell->nodes[k].y - (double)x.y;
        p[2] = (double)cell->nodes[k].z - (double)x.z;
        g[0] = (double)slopes[k].x, g[1] = (double)slopes[k].y, g[2] = (double)slopes[k].z;
        one += (double)values[k];
        for (int i = 0; i < 9; i++) outer[i / 3][i % 3] += p[i / 3] * g[i % 3];
        for (int i = 0; i < 3; i++) {
            at[i] += (double)values[k] * p[i], sum[i] += g[i];
            largest = fmax(largest, fabs(g[i]));
        }
    }
    check_near(one, 1, 20 * CHECK_EPSILON);
    for (int i = 0; i < 3; i++) check_near(at[i] / size, 0, 20 * factor * CHECK_EPSILON);
    for (int i = 0; i < 3; i++) check_near(sum[i] / largest, 0, 50 * factor * CHECK_EPSILON);
    for (int i = 0; i < 9; i++)
        check_near((outer[i / 3][i % 3] - (i % 4 == 0)) / (size * largest), 0, 500 * factor * CHECK_EPSILON);
}

/* A random point in the tetrahedron of a random triangle and the mean of the nodes: at least `least` of its height
   below the triangle. */
static dgfem_vec3 random_inside(check_random *random, const dgfem_mvc_cell *cell, double least) {
    int t = check_random_int(random, cell->triangle_count);
    double w[4], sum = 0, x[3] = {0, 0, 0}, mean[3] = {0, 0, 0};
    for (int i = 0; i < 4; i++) sum += w[i] = check_random_real(random, 0, 1);
    for (int i = 0; i < 4; i++) w[i] = w[i] / sum * (1 - least) + (i == 3 ? least : 0);
    for (int k = 0; k < cell->node_count; k++) {
        mean[0] += (double)cell->nodes[k].x / cell->node_count, mean[1] += (double)cell->nodes[k].y / cell->node_count;
        mean[2] += (double)cell->nodes[k].z / cell->node_count;
    }
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 p = cell->nodes[cell->triangles[3 * t + i]];
        x[0] += w[i] * (double)p.x, x[1] += w[i] * (double)p.y, x[2] += w[i] * (double)p.z;
    }
    return vec3(x[0] + w[3] * mean[0], x[1] + w[3] * mean[1], x[2] + w[3] * mean[2]);
}

/* Partition of unity, linear precision, positivity in all elements of random meshes. */
static void test_sums(void **state) {
    (void)state;
    check_random random = check_random_seeded(1);
    for (int kind = MVC_CUBE; kind < MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 3, 5));
        int most = 0;
        for (int e = 0; e < body->element_count; e++) {
            sample_cell s;
            take_element(&s, body, e);
            if (s.cell.node_count > most) most = s.cell.node_count;
            for (int p = 0; p < 10; p++) {
                dgfem_real values[MAX_NODES];
                dgfem_vec3 slopes[MAX_NODES], x = random_inside(&random, &s.cell, 0.02);
                check_status(dgfem_mvc_coordinates(&s.cell, x, values, slopes), DGFEM_OK);
                check_sums(&s.cell, x, values, slopes, 100);
                for (int k = 0; k < s.cell.node_count; k++) assert_true(values[k] > 0);
            }
        }
        print_message("%d elements of up to %d nodes\n", body->element_count, most);
        dgfem_mvc_destroy(body);
    }
}

/* Four nodes: linear. */
static void test_tetrahedron_is_linear(void **state) {
    (void)state;
    check_random random = check_random_seeded(2);
    sample_cell s;
    dgfem_real values[4], other[4];
    dgfem_vec3 slopes[4], others[4];
    take_reference(&s, &mvc_references[0]);
    for (int p = 0; p < 20; p++) {
        dgfem_vec3 x = random_inside(&random, &s.cell, 0.1), y = random_inside(&random, &s.cell, 0.1);
        check_status(dgfem_mvc_coordinates(&s.cell, x, values, slopes), DGFEM_OK);
        check_status(dgfem_mvc_coordinates(&s.cell, y, other, others), DGFEM_OK);
        for (int k = 0; k < 4; k++) {
            dgfem_vec3 g = slopes[k];
            double rise = (double)(g.x * (y.x - x.x) + g.y * (y.y - x.y) + g.z * (y.z - x.z));
            check_near3(slopes[k], others[k], 200 * CHECK_EPSILON);
            check_near(other[k] - values[k], rise, 100 * CHECK_EPSILON);
        }
    }
}

/* ---- an independent formula in long double, for differences ---- */

typedef long double real;

static real dot_l(const real *a, const real *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void cross_l(const real *a, const real *b, real *c) {
    c[0] = a[1] * b[2] - a[2] * b[1], c[1] = a[2] * b[0] - a[0] * b[2], c[2] = a[0] * b[1] - a[1] * b[0];
}

/* Eq. (7) to (9): the mean of the unit directions of a triangle is half the sum of angle times inward normal. */
static void values_l(const dgfem_mvc_cell *cell, const real *x, real *values) {
    real total = 0;
    for (int k = 0; k < cell->node_count; k++) values[k] = 0;
    for (int t = 0; t < cell->triangle_count; t++) {
        real d[3][3], n[3][3], m[3] = {0, 0, 0};
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 p = cell->nodes[cell->triangles[3 * t + i]];
            d[i][0] = (real)p.x - x[0], d[i][1] = (real)p.y - x[1], d[i][2] = (real)p.z - x[2];
        }
        for (int i = 0; i < 3; i++) {
            const real *a = d[(i + 1) % 3], *b = d[(i + 2) % 3];
            cross_l(a, b, n[i]);
            real s = sqrtl(dot_l(n[i], n[i])), angle = atan2l(s, dot_l(a, b));
            for (int j = 0; j < 3; j++) m[j] += angle / (2 * s) * n[i][j];
        }
        for (int i = 0; i < 3; i++) {
            real w = dot_l(m, n[i]) / dot_l(d[i], n[i]);
            values[cell->triangles[3 * t + i]] += w;
            total += w;
        }
    }
    for (int k = 0; k < cell->node_count; k++) values[k] /= total;
}

/* Central differences of order 8 with this step. */
static void slopes_l(const dgfem_mvc_cell *cell, dgfem_vec3 point, const real *step, real (*slopes)[3]) {
    static const real factor[] = {4.0L / 5, -1.0L / 5, 4.0L / 105, -1.0L / 280};
    real up[MAX_NODES], down[MAX_NODES];
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < cell->node_count; k++) slopes[k][i] = 0;
        for (int n = 1; n <= 4; n++) {
            real x[3], y[3];
            x[0] = y[0] = (real)point.x, x[1] = y[1] = (real)point.y, x[2] = y[2] = (real)point.z;
            x[i] += n * step[i], y[i] -= n * step[i];
            values_l(cell, x, up);
            values_l(cell, y, down);
            for (int k = 0; k < cell->node_count; k++) slopes[k][i] += factor[n - 1] * (up[k] - down[k]) / step[i];
        }
    }
}

/* Long double has more digits than double here; not so under valgrind. */
static int is_precise(void) {
    volatile real one = 1, tiny = 0x1p-60L, sum = one + tiny;
    return sum != one;
}

/* Gradients against differences, inside elements of random meshes, squeezed to thickness 1e-6 too. Differences are
   good to 1e-13 where they have the digits. */
static void test_differences(void **state) {
    (void)state;
    double tolerance = DGFEM_REAL_IS_FLOAT ? 2e-4 : is_precise() ? 1e-13 : 1e-10;
    for (int flat = 0; flat < 2; flat++) {
        double thickness = flat ? (DGFEM_REAL_IS_FLOAT ? 1e-2 : 1e-6) : 1, worst = 0;
        dgfem_mvc_desc desc = mvc_desc();
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(MVC_VORONOI, 3, 5));
        for (int e = 0; e < body->element_count; e++) {
            sample_cell s;
            dgfem_real values[MAX_NODES];
            dgfem_vec3 slopes[MAX_NODES];
            real exact[MAX_NODES][3], step[3];
            double largest = 0, distance = 1;
            take_element(&s, body, e);
            for (int k = 0; k < s.cell.node_count; k++) s.nodes[k].z *= (dgfem_real)thickness;
            for (int k = 0; k < s.cell.node_count; k++)
                distance = fmin(distance, check_distance(s.nodes[k], body->centre[e]));
            dgfem_vec3 x = body->centre[e];
            x.z *= (dgfem_real)thickness;
            step[0] = step[1] = step[2] = (real)(DGFEM_REAL_IS_FLOAT ? 1e-3 : 2e-4);
            for (int i = 0; i < 3; i++) step[i] *= i == 2 || flat ? (real)thickness : 1;
            check_status(dgfem_mvc_coordinates(&s.cell, x, values, slopes), DGFEM_OK);
            slopes_l(&s.cell, x, step, exact);
            for (int k = 0; k < s.cell.node_count; k++)
                for (int i = 0; i < 3; i++) largest = fmax(largest, (double)fabsl(exact[k][i]));
            for (int k = 0; k < s.cell.node_count; k++) {
                dgfem_vec3 truth = vec3((double)exact[k][0], (double)exact[k][1], (double)exact[k][2]);
                double error = check_distance(slopes[k], truth) / largest;
                worst = fmax(worst, error);
                check_near(error, 0, tolerance);
            }
        }
        print_message("thickness %g: gradients differ from differences by %.1e\n", thickness, worst);
        dgfem_mvc_destroy(body);
    }
}

/* On triangles, edges and nodes values are linear, and there are no gradients; just above a triangle they are close to
   that. */
static void test_surface(void **state) {
    (void)state;
    check_random random = check_random_seeded(4);
    for (int r = 0; r < 5; r++) {
        sample_cell s;
        if (DGFEM_REAL_IS_FLOAT && r == 3) continue;
        take_reference(&s, &mvc_references[r]);
        for (int t = 0; t < 20 * s.cell.triangle_count; t++) {
            const int *at = s.triangles + 3 * (t / 20);
            dgfem_real values[24];
            dgfem_vec3 slopes[24], p[3];
            double w[3], sum = 0;
            for (int i = 0; i < 3; i++) {
                int part = t % 4; /* 1, 2: an edge; 3: a node */
                p[i] = s.nodes[at[i]];
                w[i] = (part && i == 0) || (part == 3 && i == 1) ? 0 : check_random_real(&random, 0.01, 1);
                sum += w[i];
            }
            for (int i = 0; i < 3; i++) w[i] /= sum;
            dgfem_vec3 x = vec3(w[0] * (double)p[0].x + w[1] * (double)p[1].x + w[2] * (double)p[2].x,
                                w[0] * (double)p[0].y + w[1] * (double)p[1].y + w[2] * (double)p[2].y,
                                w[0] * (double)p[0].z + w[1] * (double)p[1].z + w[2] * (double)p[2].z);
            check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_OK);
            check_status(dgfem_mvc_coordinates(&s.cell, x, values, slopes), DGFEM_ERROR_DEGENERATE);
            for (int k = 0; k < s.cell.node_count; k++) {
                double expected = 0;
                for (int i = 0; i < 3; i++)
                    if (at[i] == k) expected = w[i];
                check_near(values[k], expected, 100 * CHECK_EPSILON);
            }
        }
    }
}

/* Outside, values keep their sums. */
static void test_outside(void **state) {
    (void)state;
    check_random random = check_random_seeded(5);
    for (int r = 0; r < 5; r++) {
        sample_cell s;
        if (r == 3) continue; /* seen from outside, the two sides of the slab all but cancel */
        take_reference(&s, &mvc_references[r]);
        for (int p = 0; p < 200; p++) {
            dgfem_real values[24];
            double sum = 0, at[3] = {0, 0, 0};
            dgfem_vec3 x = check_random_vec3(&random, -2, 2);
            check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_OK);
            for (int k = 0; k < s.cell.node_count; k++) {
                sum += (double)values[k];
                at[0] += (double)(values[k] * s.nodes[k].x), at[1] += (double)(values[k] * s.nodes[k].y);
                at[2] += (double)(values[k] * s.nodes[k].z);
            }
            check_near(sum, 1, 1e-9 * CHECK_EPSILON / 2.2e-16);
            check_near3(vec3(at[0], at[1], at[2]), x, 1e-9 * CHECK_EPSILON / 2.2e-16);
        }
    }
}

static void test_bad_cells(void **state) {
    (void)state;
    sample_cell s;
    dgfem_real values[24];
    dgfem_vec3 x = vec3(0.25, 0.125, 0.125);
    take_reference(&s, &mvc_references[1]);
    check_status(dgfem_mvc_coordinates(NULL, x, values, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_coordinates(&s.cell, x, NULL, NULL), DGFEM_ERROR_ARGUMENT);
    check_status(dgfem_mvc_coordinates(&s.cell, vec3(0, (double)NAN, 0), values, NULL), DGFEM_ERROR_NOT_FINITE);
    s.triangles[4] = 6;
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_INDEX);
    s.triangles[4] = -1;
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_INDEX);
    take_reference(&s, &mvc_references[1]);
    s.cell.triangle_count = 7;
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_OPEN);
    s.cell.triangle_count = 3;
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_ARGUMENT);
    take_reference(&s, &mvc_references[1]);
    s.nodes[2].z = (dgfem_real)INFINITY;
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_NOT_FINITE);
    for (int k = 0; k < 6; k++) s.nodes[k] = vec3(1, 2, 3);
    check_status(dgfem_mvc_coordinates(&s.cell, x, values, NULL), DGFEM_ERROR_DEGENERATE);
}

/* ---- elements ---- */

static dgfem_mvc_desc desc_of(dgfem_mvc_quadrature quadrature, double stabilisation, int b_bar) {
    dgfem_mvc_desc desc = mvc_desc();
    desc.quadrature = quadrature;
    desc.stabilisation = (dgfem_real)stabilisation;
    desc.b_bar = b_bar;
    return desc;
}

/* Pivots of a Cholesky factorization with full pivoting that are above `relative` times the first; the smallest of
   these by the first and the largest of the rest go to gap[2]. */
static int pivoted_rank(double *a, int n, double relative, double gap[2]) {
    double first = 0, pivot = 0;
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (a[i * n + i] > a[best * n + best]) best = i;
        for (int i = 0; i < n; i++) {
            double t = a[k * n + i];
            a[k * n + i] = a[best * n + i], a[best * n + i] = t;
        }
        for (int i = 0; i < n; i++) {
            double t = a[i * n + k];
            a[i * n + k] = a[i * n + best], a[i * n + best] = t;
        }
        if (k == 0) first = a[0];
        gap[1] = a[k * n + k] / first;
        if (!(gap[1] > relative)) return k;
        gap[0] = gap[1], pivot = a[k * n + k];
        for (int i = k + 1; i < n; i++)
            for (int j = k + 1; j < n; j++) a[i * n + j] -= a[i * n + k] * a[k * n + j] / pivot;
    }
    return n;
}

static double *dense_stiffness(const dgfem_mvc *body, int e, int *size) {
    int n = dgfem_mvc_element_nodes(body, e, NULL, 0);
    size_t count = 9 * (size_t)n * (size_t)n;
    dgfem_real *k = (dgfem_real *)malloc(count * sizeof *k);
    double *dense = (double *)malloc(count * sizeof *dense);
    assert_non_null(k);
    assert_non_null(dense);
    check_status(dgfem_mvc_element_stiffness(body, e, k), DGFEM_OK);
    for (size_t i = 0; i < count; i++) dense[i] = (double)k[i];
    free(k);
    *size = 3 * n;
    return dense;
}

/* Rank 3k - 6 for the elements of many random meshes and all rules. Weak modes of elements with very short edges are
   below round-off in float, but for the stabilisation. */
static void test_rank(void **state) {
    (void)state;
    double weakest = 1, noise = 0;
    int elements = 0;
    for (int m = 0; m < (check_long() ? 400 : DGFEM_REAL_IS_FLOAT ? 40 : 100); m++) {
        dgfem_mvc_desc desc = desc_of((dgfem_mvc_quadrature)(m % 3), DGFEM_REAL_IS_FLOAT ? 0.1 : 0, m / 3 % 2);
        mvc_kind kind = (mvc_kind)(1 + m % 4);
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(kind, 2, (uint64_t)m));
        for (int e = 0; e < body->element_count; e++) {
            double gap[2];
            int size;
            double *k = dense_stiffness(body, e, &size);
            assert_int_equal(pivoted_rank(k, size, DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-11, gap), size - 6);
            weakest = fmin(weakest, gap[0]), noise = fmax(noise, gap[1]);
            free(k);
            elements++;
        }
        dgfem_mvc_destroy(body);
    }
    print_message("%d elements: least pivot %.1e, beyond the rank %.1e\n", elements, weakest, noise);
}

/* Mass and centre of mass are those of the exact geometry. */
static void test_mass(void **state) {
    (void)state;
    for (int kind = MVC_CUBE; kind < MVC_KINDS; kind++) {
        dgfem_mvc_desc desc = mvc_desc();
        desc.material.density = 3;
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh((mvc_kind)kind, 3, 7));
        double mass = 0, first[3] = {0, 0, 0};
        for (int i = 0; i < body->node_count; i++) {
            double m = (double)body->mass[i];
            assert_true(m > 0);
            mass += m, first[0] += m * (double)body->rest[i].x, first[1] += m * (double)body->rest[i].y;
            first[2] += m * (double)body->rest[i].z;
        }
        check_near(mass, 3, 20 * CHECK_EPSILON);
        check_near(dgfem_mvc_mass(body), 3, 50 * CHECK_EPSILON);
        check_near(dgfem_mvc_rest_volume(body), 1, 20 * CHECK_EPSILON);
        check_near(dgfem_mvc_volume(body), 1, 20 * CHECK_EPSILON);
        for (int i = 0; i < 3; i++) check_near(first[i], 1.5, 20 * CHECK_EPSILON);
        for (int e = 0; e < body->element_count; e++) { /* each element's too: all other materials weightless */
            const dgfem_mvc_system *system = body->system;
            double sum = 0, x = 0;
            for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
                sum += (double)system->share[i];
                x += (double)system->share[i] * (double)(body->rest[system->nodes[i]].x - body->centre[e].x);
            }
            check_near(sum, 1, 20 * CHECK_EPSILON);
            check_near(x, 0, 20 * CHECK_EPSILON);
        }
        dgfem_mvc_destroy(body);
    }
}

/* Tetrahedra: K = V B^T C B with the constant gradients of the barycentric coordinates, by Cramer's rule. */
static void test_tetrahedra(void **state) {
    (void)state;
    dgfem_mvc_desc desc = desc_of(DGFEM_MVC_PAPER, 0.1, 1);
    desc.material.poisson = (dgfem_real)0.2;
    dgfem_mvc *body = mvc_of(&desc, mvc_tetrahedra());
    double mu = 1 / 2.4, lambda = 0.2 / (1.2 * 0.6);
    for (int e = 0; e < body->element_count; e++) {
        int nodes[4], size;
        double *k = dense_stiffness(body, e, &size), g[4][3], d[3][3];
        assert_int_equal(dgfem_mvc_element_nodes(body, e, nodes, 4), 4);
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 a = body->rest[nodes[i + 1]], o = body->rest[nodes[0]];
            d[i][0] = (double)(a.x - o.x), d[i][1] = (double)(a.y - o.y), d[i][2] = (double)(a.z - o.z);
        }
        double det = 0;
        for (int i = 0; i < 3; i++) /* column i of the inverse of d */
            for (int j = 0; j < 3; j++) {
                int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, s = (j + 2) % 3;
                g[i + 1][j] = d[p][r] * d[q][s] - d[p][s] * d[q][r];
            }
        for (int j = 0; j < 3; j++) det += d[0][j] * g[1][j];
        for (int j = 0; j < 3; j++) {
            for (int i = 1; i < 4; i++) g[i][j] /= det;
            g[0][j] = -g[1][j] - g[2][j] - g[3][j];
        }
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < 4; b++)
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) {
                        double inner = g[a][0] * g[b][0] + g[a][1] * g[b][1] + g[a][2] * g[b][2];
                        double exact = lambda * g[a][i] * g[b][j] + mu * g[a][j] * g[b][i] + (i == j ? mu * inner : 0);
                        check_near(k[(3 * a + i) * 12 + 3 * b + j], exact * fabs(det) / 6, 20 * CHECK_EPSILON);
                    }
        free(k);
    }
    dgfem_mvc_destroy(body);
}

/* ---- patch test ---- */

/* Largest error of the displacement, all boundary nodes moved linearly, relative to it. */
static double patch_error(dgfem_mvc *body, check_random *random) {
    mvc_affine field = mvc_random_affine(random, 1);
    int count, id, *nodes = mvc_boundary(body, &count);
    double worst = 0, size = 0;
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, vec3(0, 0, 0), &id), DGFEM_OK);
    check_status(dgfem_mvc_move_fixture(body, id, field.linear, field.offset), DGFEM_OK);
    check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 u = mvc_affine_at(&field, body->rest[i]);
        dgfem_vec3 x =
            vec3((double)(body->rest[i].x + u.x), (double)(body->rest[i].y + u.y), (double)(body->rest[i].z + u.z));
        worst = fmax(worst, check_distance(body->position[i], x));
        size = fmax(size, check_distance(u, vec3(0, 0, 0)));
    }
    free(nodes);
    return worst / size;
}

/* The corrected rules reproduce linear fields on any mesh; the rule as published does not. */
static void test_patch(void **state) {
    (void)state;
    check_random random = check_random_seeded(6);
    double worst[3] = {0, 0, 0}, least_raw = 1;
    for (int m = 0; m < (DGFEM_REAL_IS_FLOAT && !check_long() ? 18 : 36); m++) {
        dgfem_mvc_quadrature quadrature = (dgfem_mvc_quadrature)(m % 3);
        mvc_kind kind = (mvc_kind)(1 + m / 3 % 3);
        dgfem_mvc_desc desc = desc_of(quadrature, m % 2 ? 0.1 : 0, m / 2 % 2);
        desc.warp = 0;
        dgfem_mvc *body = mvc_of(&desc, mvc_mesh(kind, kind == MVC_VORONOI ? 2 : 3, (uint64_t)(m / 3)));
        double error = patch_error(body, &random);
        worst[m % 3] = fmax(worst[m % 3], error);
        if (quadrature == DGFEM_MVC_PAPER_RAW) least_raw = fmin(least_raw, error);
        else check_near(error, 0, DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-12);
        dgfem_mvc_destroy(body);
    }
    print_message("errors: tet4 %.1e, paper %.1e, raw %.1e to %.1e\n", worst[0], worst[1], least_raw, worst[2]);
    assert_true(least_raw > 1e-4);
}

/* ---- convergence ---- */

static const double nu = 0.3;

/* A smooth displacement without body forces, by Papkovich and Neuber: 4 (1 - nu) B - grad (x . B), B = (psi, 0, 0),
   with the harmonic psi = exp(0.75 x) sin(0.45 y + 0.3) sin(0.6 z + 0.2). m: its gradient, or NULL. */
static void smooth_field(const double *p, double *u, double (*m)[3]) {
    static const double k[3] = {0.75, 0.45, 0.6};
    double f[3][4]; /* factors of psi and their derivatives */
    double psi[4][4][4];
    for (int n = 0; n < 4; n++) {
        double quarter = n * 1.5707963267948966;
        f[0][n] = pow(k[0], n) * exp(k[0] * p[0]);
        f[1][n] = pow(k[1], n) * sin(k[1] * p[1] + 0.3 + quarter);
        f[2][n] = pow(k[2], n) * sin(k[2] * p[2] + 0.2 + quarter);
    }
    for (int i = 0; i < 64; i++) psi[i / 16][i / 4 % 4][i % 4] = f[0][i / 16] * f[1][i / 4 % 4] * f[2][i % 4];
    for (int i = 0; i < 3; i++) {
        int a = i == 0, b = i == 1, c = i == 2;
        u[i] = (a ? (3 - 4 * nu) * psi[0][0][0] : 0) - p[0] * psi[a][b][c];
        for (int j = 0; m && j < 3; j++) {
            int x = j == 0, y = j == 1, z = j == 2;
            m[i][j] = (a ? (3 - 4 * nu) * psi[x][y][z] : 0) - (x ? psi[a][b][c] : 0) - p[0] * psi[a + x][b + y][c + z];
        }
    }
}

static void smooth_fn(void *user, dgfem_vec3 rest, dgfem_vec3 *displacement) {
    double p[3], u[3];
    (void)user;
    p[0] = (double)rest.x, p[1] = (double)rest.y, p[2] = (double)rest.z;
    smooth_field(p, u, NULL);
    *displacement = vec3(u[0], u[1], u[2]);
}

/* sigma : epsilon of a displacement gradient, for E = 1. */
static double energy_density(double (*m)[3]) {
    double mu = 1 / (2 * (1 + nu)), lambda = nu / ((1 + nu) * (1 - 2 * nu)), sum = 0;
    double trace = m[0][0] + m[1][1] + m[2][2];
    for (int i = 0; i < 9; i++) {
        double strain = (m[i / 3][i % 3] + m[i % 3][i / 3]) / 2;
        sum += 2 * mu * strain * strain;
    }
    return sum + lambda * trace * trace;
}

/* L2 and energy norms of the error, by samples of the basis functions themselves in the tetrahedra of all triangles. */
static void solution_errors(const dgfem_mvc *body, double *l2, double *energy) {
    *l2 = *energy = 0;
    for (int e = 0; e < body->element_count; e++) {
        sample_cell s;
        int nodes[MAX_NODES], n = dgfem_mvc_element_nodes(body, e, nodes, MAX_NODES);
        double c[3];
        take_element(&s, body, e);
        c[0] = (double)body->centre[e].x, c[1] = (double)body->centre[e].y, c[2] = (double)body->centre[e].z;
        for (int t = 0; t < s.cell.triangle_count; t++) {
            double p[4][3], d[3][3], v;
            for (int i = 0; i < 3; i++) {
                dgfem_vec3 q = s.nodes[s.triangles[3 * t + i]];
                p[i][0] = (double)q.x, p[i][1] = (double)q.y, p[i][2] = (double)q.z, p[3][i] = c[i];
            }
            for (int i = 0; i < 9; i++) d[i / 3][i % 3] = p[i / 3][i % 3] - c[i % 3];
            v = (d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                 d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0])) /
                6;
            double x[3] = {0, 0, 0}, u[3], m[3][3];
            dgfem_real phi[MAX_NODES];
            dgfem_vec3 slope[MAX_NODES];
            for (int i = 0; i < 12; i++) x[i % 3] += p[i / 3][i % 3] / 4;
            smooth_field(x, u, m);
            check_status(dgfem_mvc_coordinates(&s.cell, vec3(x[0], x[1], x[2]), phi, slope), DGFEM_OK);
            for (int k = 0; k < n; k++) {
                dgfem_vec3 a = body->position[nodes[k]], b = body->rest[nodes[k]];
                double w[3], g[3];
                w[0] = (double)(a.x - b.x), w[1] = (double)(a.y - b.y), w[2] = (double)(a.z - b.z);
                g[0] = (double)slope[k].x, g[1] = (double)slope[k].y, g[2] = (double)slope[k].z;
                for (int i = 0; i < 3; i++) u[i] -= (double)phi[k] * w[i];
                for (int i = 0; i < 9; i++) m[i / 3][i % 3] -= w[i / 3] * g[i % 3];
            }
            *l2 += v * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
            *energy += v * energy_density(m);
        }
    }
    *l2 = sqrt(*l2), *energy = sqrt(*energy);
}

/* Order 2 in L2 and 1 in the energy norm, for both corrected rules. */
static void test_convergence(void **state) {
    (void)state;
    for (int m = 0; m < (check_long() ? 4 : DGFEM_REAL_IS_FLOAT ? 1 : 3); m++) {
        mvc_kind kind = m < 2 ? MVC_HEX : MVC_VORONOI;
        int coarse = 2, fine = check_long() ? 8 : 4;
        double l2[2], energy[2];
        for (int k = 0; k < 2; k++) {
            dgfem_mvc_desc desc = desc_of(m % 2 ? DGFEM_MVC_PAPER : DGFEM_MVC_TET4, 0, 0);
            desc.warp = 0;
            dgfem_mvc *body = mvc_of(&desc, mvc_mesh(kind, k ? fine : coarse, 3));
            int count, *nodes = mvc_boundary(body, &count);
            check_status(dgfem_mvc_fix_nodes_fn(body, nodes, count, DGFEM_MVC_XYZ, smooth_fn, NULL, NULL), DGFEM_OK);
            check_status(dgfem_mvc_solve_static(body, NULL, NULL), DGFEM_OK);
            solution_errors(body, &l2[k], &energy[k]);
            free(nodes);
            dgfem_mvc_destroy(body);
        }
        double ratio = log((double)fine / coarse), order = log(l2[0] / l2[1]) / ratio;
        double order_energy = log(energy[0] / energy[1]) / ratio;
        print_message("%s, %s: L2 %.2e %.2e order %.2f, energy %.2e %.2e order %.2f\n", m < 2 ? "hexahedra" : "Voronoi",
                      m % 2 ? "paper" : "tet4", l2[0], l2[1], order, energy[0], energy[1], order_energy);
        assert_true(order > 1.8);
        assert_true(order_energy > 0.9);
    }
}

/* Nodes within 1e-4 of a plane x_axis = offset are held along some axes. */
static void hold_plane(dgfem_mvc *body, int axis, double offset, int axes) {
    dgfem_plane plane = convex_mesh_plane(axis == 0, axis == 1, axis == 2, offset);
    int nodes[1024], count = dgfem_mvc_nodes_on_plane(body, plane, (dgfem_real)1e-4, nodes, 1024);
    assert_in_range(count, 1, 1024);
    check_status(dgfem_mvc_fix_nodes(body, nodes, count, axes, vec3(0, 0, 0), NULL), DGFEM_OK);
}

/* Tractions (-y, 0, 0) on the side x = length, each triangle's integrated exactly. */
static void bend_end(dgfem_mvc *body, double length) {
    dgfem_plane plane = convex_mesh_plane(1, 0, 0, length);
    int faces[256], count = dgfem_mvc_faces_on_plane(body, plane, (dgfem_real)1e-4, faces, 256), triangles[64 * 3];
    assert_in_range(count, 1, 256);
    for (int k = 0; k < count; k++) {
        int many = dgfem_mvc_face_triangles(body, faces[k], triangles, 64);
        for (int t = 0; t < many; t++) {
            double y[3], z[3], sum = 0, area;
            for (int i = 0; i < 3; i++) {
                dgfem_vec3 p = body->rest[triangles[3 * t + i]];
                y[i] = (double)p.y, z[i] = (double)p.z, sum += y[i];
            }
            area = fabs((y[1] - y[0]) * (z[2] - z[0]) - (y[2] - y[0]) * (z[1] - z[0])) / 2;
            for (int i = 0; i < 3; i++)
                check_status(
                    dgfem_mvc_add_force(body, &triangles[3 * t + i], 1, vec3(-area / 12 * (y[i] + sum), 0, 0), NULL),
                    DGFEM_OK);
        }
    }
}

/* Energy of a bar of 4 x 1 x 1/2 bent by end moments, by that of the exact solution (Saint Venant's), E k^2 I L / 2: at
   Poisson's ratio 0.4999 elements lock, but not with B-bar. */
static double bending_energy(double poisson, int b_bar, dgfem_mvc_quadrature quadrature) {
    dgfem_grid_desc grid = dgfem_default_grid_desc();
    dgfem_mvc_desc desc = desc_of(quadrature, 0, b_bar);
    dgfem_mvc_static_desc statics = dgfem_default_mvc_static_desc();
    dgfem_mesh *mesh = NULL;
    dgfem_energy energy;
    if (DGFEM_REAL_IS_FLOAT)
        statics.tolerance = (dgfem_real)1e-2; /* the bulk modulus is 5000 times the shear modulus */
    grid.lower = vec3(0, -0.5, 0), grid.upper = vec3(4, 0.5, 0.5);
    grid.cells[0] = 12, grid.cells[1] = 4, grid.cells[2] = 2;
    check_status(dgfem_mesh_create_grid(&grid, &mesh), DGFEM_OK);
    desc.warp = 0;
    desc.material.poisson = (dgfem_real)poisson;
    dgfem_mvc *body = mvc_of(&desc, mesh);
    int corner = dgfem_mvc_nearest_node(body, vec3(0, 0, 0));
    hold_plane(body, 0, 0, DGFEM_MVC_X);
    hold_plane(body, 2, 0, DGFEM_MVC_Z);
    check_status(dgfem_mvc_fix_nodes(body, &corner, 1, DGFEM_MVC_Y, vec3(0, 0, 0), NULL), DGFEM_OK);
    bend_end(body, 4);
    check_status(dgfem_mvc_solve_static(body, &statics, NULL), DGFEM_OK);
    check_status(dgfem_mvc_energy(body, &energy), DGFEM_OK);
    dgfem_mvc_destroy(body);
    return (double)energy.elastic / (4.0 * 0.5 / 12 / 2);
}

static void test_locking(void **state) {
    (void)state;
    double compressible = bending_energy(0.3, 0, DGFEM_MVC_TET4), barred = bending_energy(0.3, 1, DGFEM_MVC_TET4);
    print_message("nu 0.3: %.3f, with B-bar %.3f of the exact energy\n", compressible, barred);
    assert_true(compressible > 0.85 && compressible < 1);
    assert_true(barred > 0.9 && barred < 1.02);
    for (int q = 0; q < 2; q++) {
        double locked = bending_energy(0.4999, 0, (dgfem_mvc_quadrature)q);
        double free_one = bending_energy(0.4999, 1, (dgfem_mvc_quadrature)q);
        print_message("nu 0.4999, rule %d: %.3f, with B-bar %.3f of the exact energy\n", q, locked, free_one);
        assert_true(locked < 0.5);
        assert_true(free_one > 0.9 && free_one < 1.02);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_reference),
        cmocka_unit_test(test_sums),
        cmocka_unit_test(test_tetrahedron_is_linear),
        cmocka_unit_test(test_differences),
        cmocka_unit_test(test_surface),
        cmocka_unit_test(test_outside),
        cmocka_unit_test(test_bad_cells),
        cmocka_unit_test(test_rank),
        cmocka_unit_test(test_mass),
        cmocka_unit_test(test_tetrahedra),
        cmocka_unit_test(test_patch),
        cmocka_unit_test(test_convergence),
        cmocka_unit_test(test_locking),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

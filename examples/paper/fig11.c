/* Fig. 11: slivers. Nine elements: a regular tetrahedron at the origin, four frusta around it up to a tetrahedron half
   as large as the outermost, four frusta beyond; the innermost one shrinks to the size s. The outer face below is held.

   Condition numbers of the stiffness matrix (E = 1, nu = 0.3, IP, default penalty): in the library's basis, centred and
   scaled for each element, raw and after scaling by the diagonal, and in the paper's basis, monomials of the global
   coordinates, to which the matrix is transformed exactly. */
#include "paper.h"

static const double corner[4][3] = {{1, 1, 1}, {-1, -1, 1}, {-1, 1, -1}, {1, -1, -1}};
static const int side[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}; /* opposite corner i, seen from outside */

static dgfem_polyhedron *polyhedron(const dgfem_vec3 *vertices, int vertex_count, const int *start, const int *loops,
                                    int faces) {
    dgfem_polyhedron_desc desc = dgfem_default_polyhedron_desc();
    dgfem_polyhedron *p;
    desc.vertices = vertices, desc.vertex_count = vertex_count;
    desc.face_count = faces, desc.loop_start = start, desc.loop_vertices = loops;
    desc.hooks = paper_hooks();
    need(dgfem_polyhedron_create(&desc, &p), "polyhedron");
    return p;
}

static dgfem_vec3 scaled_corner(int i, double s) { return vec3(s * corner[i][0], s * corner[i][1], s * corner[i][2]); }

static dgfem_polyhedron *tetrahedron(double s) {
    static const int start[5] = {0, 3, 6, 9, 12};
    dgfem_vec3 vertices[4];
    int loops[12];
    for (int i = 0; i < 4; i++) vertices[i] = scaled_corner(i, s);
    for (int i = 0; i < 12; i++) loops[i] = side[i / 3][i % 3];
    return polyhedron(vertices, 4, start, loops, 4);
}

/* Between face f of the tetrahedra of the sizes s < t. */
static dgfem_polyhedron *frustum(int f, double s, double t) {
    static const int start[6] = {0, 3, 6, 10, 14, 18};
    static const int loops[18] = {2, 1, 0, 3, 4, 5, 0, 1, 4, 3, 1, 2, 5, 4, 2, 0, 3, 5};
    dgfem_vec3 vertices[6];
    for (int i = 0; i < 6; i++) vertices[i] = scaled_corner(side[f][i % 3], i < 3 ? s : t);
    return polyhedron(vertices, 6, start, loops, 5);
}

static dgfem_mesh *nest(double s) {
    dgfem_polyhedron *parts[9];
    dgfem_weld_desc desc = dgfem_default_weld_desc();
    dgfem_mesh *mesh;
    desc.tolerance = 1e-9 * s;
    desc.hooks = paper_hooks();
    parts[0] = tetrahedron(s);
    for (int f = 0; f < 4; f++) parts[1 + f] = frustum(f, s, 0.5), parts[5 + f] = frustum(f, 0.5, 1);
    need(dgfem_mesh_create_polyhedra((const dgfem_polyhedron *const *)parts, 9, &desc, &mesh), "nine elements");
    for (int i = 0; i < 9; i++) dgfem_polyhedron_destroy(parts[i]);
    return mesh;
}

static dgfem_body *make(double s, int degree) {
    dgfem_body_desc desc = linear_desc(1, 0.3);
    desc.degree = degree;
    desc.gravity = vec3(0, 0, -1);
    dgfem_body *body = body_of(desc, nest(s));
    hold_plane(body, plane(-1 / sqrt(3), -1 / sqrt(3), -1 / sqrt(3), 1 / sqrt(3)));
    if (!solve_linear(body, NULL)) need(DGFEM_ERROR_NOT_POSITIVE_DEFINITE, "nine elements");
    return body;
}

/* The monomials of x in those of xi, x = c + h xi: row of the global one, column of the element's. */
static void global_monomials(dgfem_vec3 c, double h, int degree, double *t) {
    static const double binomial[4][4] = {{1, 0, 0, 0}, {1, 1, 0, 0}, {1, 2, 1, 0}, {1, 3, 3, 1}};
    int n = dgfem_monomial_count(degree);
    memset(t, 0, (size_t)(n * n) * sizeof *t);
    for (int i = 0; i <= degree; i++)
        for (int j = 0; i + j <= degree; j++)
            for (int k = 0; i + j + k <= degree; k++)
                for (int a = 0; a <= i; a++)
                    for (int b = 0; b <= j; b++)
                        for (int d = 0; d <= k; d++)
                            t[dgfem_monomial_index(i, j, k) * n + dgfem_monomial_index(a, b, d)] =
                                binomial[i][a] * binomial[j][b] * binomial[k][d] * pow(c.x, i - a) * pow(c.y, j - b) *
                                pow(c.z, k - d) * pow(h, a + b + d);
}

/* T K T^T, dense; to be freed. */
static double *global_matrix(const dgfem_body *body) {
    const dgfem_matrix *m = body->matrix;
    int size = m->size, elements = body->mesh->element_count, nb = size / (3 * elements);
    double *k = matrix_dense(m), *tk = need_reals((size_t)size * (size_t)size), t[20 * 20];
    for (int pass = 0; pass < 2; pass++) { /* tk = T k, transposed: after two passes T K T^T */
        for (int e = 0; e < elements; e++) {
            global_monomials(body->origin[e], body->scale[e], body->degree[e], t);
            for (int i = 0; i < nb; i++)
                for (int a = 0; a < 3; a++)
                    for (int column = 0; column < size; column++) {
                        double sum = 0;
                        for (int j = 0; j < nb; j++)
                            sum += t[i * nb + j] * k[(m->offset[e] + 3 * j + a) * size + column];
                        tk[column * size + m->offset[e] + 3 * i + a] = sum;
                    }
        }
        memcpy(k, tk, (size_t)size * (size_t)size * sizeof *k);
    }
    free(tk);
    return k;
}

typedef struct conditions {
    double raw, scaled, global;
} conditions;

static conditions measure(double s, int degree) {
    dgfem_body *body = make(s, degree);
    double *global = global_matrix(body);
    conditions c;
    c.raw = matrix_condition(body->matrix, 0);
    c.scaled = matrix_condition(body->matrix, 1);
    c.global = dense_condition(global, body->matrix->size, 0, NULL);
    free(global);
    dgfem_body_destroy(body);
    return c;
}

int main(int argc, char **argv) {
    static const double sizes[] = {0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001};
    enum { SIZES = sizeof sizes / sizeof *sizes };
    program options = program_begin(argc, argv, "fig11 [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    conditions c[3][SIZES];
    int levels = out->quick ? 6 : SIZES, a = levels - 3, b = levels - 1;
    for (int degree = 1; degree <= 2; degree++) {
        char title[80];
        snprintf(title, sizeof title, "Condition numbers, p = %d", degree);
        paper_table(out, title, "size s|Vmin/Vmax|centred, Jacobi|centred, raw|global monomials, raw");
        for (int i = 0; i < levels; i++) {
            double s = sizes[i], volume = s * s * s / ((1 - 0.125) / 4);
            c[degree][i] = measure(s, degree);
            paper_row(out, "%g|%.1e|%.4g|%.4g|%.3g", s, volume, c[degree][i].scaled, c[degree][i].raw,
                      c[degree][i].global);
        }
        paper_print(out);
    }
    double ratio = sizes[a] / sizes[b];
    paper_note("Beyond about 1e15 the figures are round-off.");
    paper_table(out, "Fig. 11 row by row", "quantity|ours|paper|expected");
    paper_row(out, "p=1, global monomials: power of s|%.2f|grows as Vmax/Vmin, s^-3|-3",
              paper_rate(c[1][b].global, c[1][a].global, 1 / ratio));
    paper_row(out, "p=2, global monomials, s = 0.05 to 0.01: power of s|%.2f|-|-5",
              paper_rate(c[2][5].global, c[2][3].global, sizes[5] / sizes[3]));
    paper_row(out, "p=1, centred basis, raw: power of s|%.2f|-|-1", paper_rate(c[1][b].raw, c[1][a].raw, 1 / ratio));
    paper_row(out, "p=1, centred basis, Jacobi: s = 0.1 / smallest s|%.3f|-|constant", c[1][2].scaled / c[1][b].scaled);
    paper_row(out, "p=1, centred basis, Jacobi: smallest s|%.0f|-|1030", c[1][b].scaled);
    paper_print(out);
    paper_end(out);
    return 0;
}

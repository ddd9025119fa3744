/* What must not matter: rigid motion, the elements' rotations, the place of the body, the unit of length.

   Rigid rotation by any angle gives no force (E = 1, unit cube cut by random planes). The warped stiffness matrix is
   positive definite whatever rotations the elements have, if the penalty exceeds the bound theta of
   dgfem_body_stability_bound. A bar, bent by its weight and swinging, moves alike 1e6 lengths away from the origin and
   in other units of length. */
#include "paper.h"

/* ---- rigid motion ---- */

static dgfem_mat3 random_rotation(unsigned long long *state) {
    dgfem_mat3 f, identity = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (int i = 0; i < 9; i++) f.m[i / 3][i % 3] = random_number(state) - 0.5;
    return dgfem_rotation_of(f, identity);
}

/* Rotation minus identity: the gradient of the displacement. */
static dgfem_mat3 turn_of(dgfem_mat3 r) {
    for (int i = 0; i < 3; i++) r.m[i][i] -= 1;
    return r;
}

static double largest_force(const dgfem_body *body) {
    dgfem_vec3 *force = (dgfem_vec3 *)need_memory((size_t)body->basis_count, sizeof *force);
    double largest = 0;
    need(dgfem_body_internal_force(body, force), "internal force");
    for (int i = 0; i < body->basis_count; i++) {
        double size = sqrt(force[i].x * force[i].x + force[i].y * force[i].y + force[i].z * force[i].z);
        if (!(size <= largest)) largest = size;
    }
    free(force);
    return largest;
}

static double force_of_rotations(int degree, dgfem_flux flux, dgfem_penalty penalty) {
    unsigned long long state = 5;
    double largest = 0;
    dgfem_body_desc desc = linear_desc(1, 0.3);
    desc.degree = degree, desc.flux = flux, desc.penalty = penalty, desc.warp = 1;
    dgfem_body *body = body_of(desc, cut_cubes(3, 5));
    for (int k = 0; k < 20; k++) {
        dgfem_mat3 turn = turn_of(random_rotation(&state));
        need(dgfem_body_set_affine(body, turn, vec3(random_number(&state), random_number(&state), 0)), "rotation");
        double force = largest_force(body);
        if (!(force <= largest)) largest = force;
    }
    dgfem_body_destroy(body);
    return largest;
}

/* ---- definiteness ---- */

typedef struct definiteness {
    double theta, eta, least, asymmetry; /* least eigenvalue after scaling by the diagonal */
    int rounds, failed;
} definiteness;

static double largest_theta(const dgfem_body *body) {
    double largest = 0, theta;
    for (int e = 0; e < body->mesh->element_count; e++) {
        need(dgfem_body_stability_bound(body, e, &theta), "theta");
        if (!(theta <= largest)) largest = theta;
    }
    return largest;
}

/* |K - K^T| of the diagonal blocks, which are stored whole, by the largest number of the block. */
static double asymmetry_of(const dgfem_matrix *m) {
    double worst = 0;
    for (int r = 0; r < m->block_count; r++) {
        int n = m->offset[r + 1] - m->offset[r];
        const double *k = m->values + m->value_start[m->row_start[r + 1] - 1];
        double difference = 0, size = 0;
        for (int i = 0; i < n * n; i++) {
            double d = fabs(k[i] - k[i % n * n + i / n]);
            if (d > difference) difference = d;
            if (fabs(k[i]) > size) size = fabs(k[i]);
        }
        if (!(difference / size <= worst)) worst = difference / size;
    }
    return worst;
}

/* The matrix under random rotations of the elements is that of the first sweep of a static solve. */
static void rotate_elements(dgfem_body *body, unsigned long long *state) {
    for (int e = 0; e < body->mesh->element_count; e++) {
        dgfem_mat3 turn = turn_of(random_rotation(state));
        dgfem_vec3 *u = body->displacement + body->basis_start[e];
        double s = body->scale[e];
        memset(u, 0, (size_t)(body->basis_start[e + 1] - body->basis_start[e]) * sizeof *u);
        for (int j = 0; j < 3; j++) u[1 + j] = vec3(s * turn.m[0][j], s * turn.m[1][j], s * turn.m[2][j]);
    }
}

static definiteness measure_definiteness(int degree, double factor) {
    unsigned long long state = 9;
    definiteness d;
    dgfem_body_desc desc = linear_desc(1, 0.3);
    dgfem_static_desc once = dgfem_default_static_desc();
    memset(&d, 0, sizeof d);
    desc.degree = degree, desc.warp = 1;
    desc.hooks.log = NULL; /* one sweep does not converge, and says so */
    once.max_sweeps = 1;
    dgfem_body *body = body_of(desc, cut_cubes(2, 4));
    hold_plane(body, plane(1, 0, 0, 0));
    d.theta = largest_theta(body);
    d.eta = factor > 0 ? factor * d.theta : body->desc.eta;
    need(dgfem_body_set_eta(body, d.eta), "eta");
    d.least = HUGE_VAL;
    for (d.rounds = 0; d.rounds < 10; d.rounds++) {
        rotate_elements(body, &state);
        if (dgfem_body_solve_static(body, &once, NULL) == DGFEM_ERROR_NOT_POSITIVE_DEFINITE) d.failed++;
        double asymmetry = asymmetry_of(body->matrix), least;
        double *dense = matrix_dense(body->matrix), *values = need_reals((size_t)body->matrix->size);
        dense_equilibrate(dense, body->matrix->size);
        if (d.rounds < (degree == 3 ? 1 : 10)) { /* dense and slow */
            dense_eigenvalues(dense, body->matrix->size, values);
            least = values[0];
            if (!(least >= d.least)) d.least = least;
        }
        if (!(asymmetry <= d.asymmetry)) d.asymmetry = asymmetry;
        free(dense);
        free(values);
    }
    dgfem_body_destroy(body);
    return d;
}

/* ---- place and units ---- */

typedef struct setting {
    const char *name;
    double offset, unit; /* lengths are multiplied by unit, after the offset */
} setting;

/* A bar of 4 x 1 x 1 m, 2.5e6 Pa, held at one end, bent by its weight, then released from the load: displacement
   coefficients in metres, after a static solve (steps 0) or so many steps; to be freed. */
static double *bend(const setting *s, int nx, int ny, int degree, int steps, int *size) {
    dgfem_body_desc desc = linear_desc(2.5e6 / s->unit, 0.3);
    dgfem_static_desc solve = dgfem_default_static_desc();
    double o = s->offset * s->unit, l = s->unit;
    dgfem_body *body;
    double *u;
    int count, *faces;
    desc.material.density = 1000 / (l * l * l);
    desc.gravity = vec3(0, 0, -9.81 * l);
    desc.degree = degree, desc.warp = 1;
    body = body_of(desc, grid_mesh(vec3(o, -o, o), vec3(o + 4 * l, l - o, o + l), nx, ny, ny));
    faces = (int *)need_memory((size_t)body->mesh->face_count, sizeof *faces);
    count = dgfem_mesh_faces_on_plane(body->mesh, plane(1, 0, 0, o), 1e-6 * l, faces, body->mesh->face_count);
    need(dgfem_body_fix_faces(body, faces, count, vec3(0, 0, 0), NULL), "fix_faces");
    solve.load_steps = 2;
    if (!steps) need(dgfem_body_solve_static(body, &solve, NULL), "bar");
    for (int step = 0; step < steps; step++) need(dgfem_body_step(body, 1.0 / 60, NULL), "step");
    *size = 3 * body->basis_count;
    u = need_reals((size_t)*size);
    for (int i = 0; i < *size; i++) u[i] = ((const double *)(const void *)body->displacement)[i] / l;
    free(faces);
    dgfem_body_destroy(body);
    return u;
}

/* Largest difference of the coefficients by the largest coefficient. */
static double difference(const setting *s, int nx, int ny, int degree, int steps) {
    static const setting home = {"", 0, 1};
    int size;
    double *a = bend(&home, nx, ny, degree, steps, &size), *b = bend(s, nx, ny, degree, steps, &size), most = 0,
           worst = 0;
    for (int i = 0; i < size; i++) {
        if (fabs(a[i]) > most) most = fabs(a[i]);
        if (!(fabs(a[i] - b[i]) <= worst)) worst = fabs(a[i] - b[i]);
    }
    free(a);
    free(b);
    return worst / most;
}

int main(int argc, char **argv) {
    static const char *const penalties[4] = {"split (default)", "tensor", "scalar", "BZ, split"};
    static const setting settings[5] = {{"1e6 m away", 1e6, 1},
                                        {"in kilometres", 0, 1e-3},
                                        {"in millimetres", 0, 1e3},
                                        {"1e6 m away, in kilometres", 1e6, 1e-3},
                                        {"1e6 m away, in millimetres", 1e6, 1e3}};
    program options = program_begin(argc, argv, "invariance [--csv FILE] [--markdown] [--quick]");
    paper *out = paper_begin(&options);
    double force = 0, asymmetry = 0, least = HUGE_VAL, moved = 0;
    int failed = 0;
    paper_table(out, "Rigid rotation: largest force on a coefficient, 20 rotations", "penalty|p=1|p=2|p=3");
    for (int k = 0; k < 4; k++) {
        double f[4];
        for (int degree = 1; degree <= 3; degree++) {
            f[degree] = force_of_rotations(degree, k == 3 ? DGFEM_FLUX_BZ : DGFEM_FLUX_IP, (dgfem_penalty)(k % 3));
            if (!(f[degree] <= force)) force = f[degree];
        }
        paper_row(out, "%s|%.1e|%.1e|%.1e", penalties[k], f[1], f[2], f[3]);
    }
    paper_print(out);
    paper_table(out, "Stiffness under random rotations of 23 polyhedra",
                "p|eta|largest theta|not definite|least eigenvalue (Jacobi)|asymmetry");
    for (int degree = 1; degree <= 3; degree++)
        for (int k = 0; k < 2; k++) {
            definiteness d = measure_definiteness(degree, k ? 1.01 : 0);
            paper_row(out, "%d|%.3f|%.3f|%d of %d|%.1e|%.1e", degree, d.eta, d.theta, d.failed, d.rounds, d.least,
                      d.asymmetry);
            failed += d.failed;
            if (!(d.least >= least)) least = d.least;
            if (!(d.asymmetry <= asymmetry)) asymmetry = d.asymmetry;
        }
    paper_print(out);
    paper_table(
        out, "Place and units: relative difference of the displacement",
        "setting|static, 8x2x2 p=1|static, 8x2x2 p=2|static, 10x3x3 p=1|30 steps, 10x3x3 p=1|30 steps, 8x2x2 p=3");
    for (int k = 0; k < 5; k++) {
        const setting *s = &settings[k];
        double d[5] = {difference(s, 8, 2, 1, 0), difference(s, 8, 2, 2, 0), difference(s, 10, 3, 1, 0),
                       difference(s, 10, 3, 1, 30), out->quick ? 0 : difference(s, 8, 2, 3, 30)};
        for (int i = 0; i < 5; i++)
            if (!(d[i] <= moved)) moved = d[i];
        paper_row(out, "%s|%.1e|%.1e|%.1e|%.1e|%.1e", s->name, d[0], d[1], d[2], d[3], d[4]);
    }
    paper_print(out);
    paper_table(out, "Invariance row by row", "quantity|ours|expected");
    paper_row(out, "rigid rotation: largest force / E|%.1e|below 1e-12", force);
    paper_row(out, "asymmetry of the warped stiffness|%.1e|round-off", asymmetry);
    paper_row(out, "not definite under random rotations|%d|0", failed);
    paper_row(out, "least eigenvalue (Jacobi)|%.1e|positive", least);
    paper_row(out, "other places and units: largest difference|%.1e|below 1e-8", moved);
    paper_print(out);
    paper_end(out);
    return 0;
}

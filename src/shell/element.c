#pragma once
#include "mesh.c"
/* Precomputed terms of the elements' quadrature points: membrane and bending strain as matrices, stiffness, frames.

   A quadrature point of an element, of a glued edge or of a boundary edge is a point in the same sense: its `rows`
   strains are S u for the displacements u of its group's nodes, its stresses C S u, its stiffness S^T C S.

       element  S = [Bn; Bm] (6 rows: 11, 22, 2*12 of membrane strain e and bending strain r), C = w j diag(Hn, Hm)
       edge     S = [J; M]   (2 rows: jump of the normal's tilt, mean moment),  C = ds [eta / h * D, 1; 1, 0]

   D = E h^3 / (12 (1 - nu^2)). The point's rotation R comes from F = sum x_a D_a^T + t t0^T, where D_a are the
   gradients kept here. */

enum {
    DGFEM_SHELLI_MAX_GROUP = 2 * DGFEM_SHELL_MAX_NODES,
    DGFEM_SHELLI_MAX_ROWS = 6,
    DGFEM_SHELLI_MAX_WIDTH = 3 * DGFEM_SHELLI_MAX_GROUP,
    DGFEM_SHELLI_DENSE = DGFEM_SHELLI_MAX_WIDTH * DGFEM_SHELLI_MAX_WIDTH
};

typedef enum dgfem_shelli_kind { DGFEM_SHELLI_ELEMENT, DGFEM_SHELLI_GLUE, DGFEM_SHELLI_BOUNDARY } dgfem_shelli_kind;

/* The nodes of one element, or of the one or two elements at an edge, and its quadrature points. */
typedef struct dgfem_shelli_group {
    dgfem_shelli_kind kind;
    int owner; /* element or edge */
    int sides; /* elements: 1 or 2 */
    int element[2];
    signed char local[2][DGFEM_SHELL_MAX_NODES]; /* where the nodes of each side stand among the group's */
    int node_start, node_count;                  /* range of system->nodes */
    int point_start, point_count;
    size_t map_start; /* of the n (n + 1) / 2 pairs (a >= b) in system->map */
} dgfem_shelli_group;

typedef struct dgfem_shelli_point {
    int basis[2];          /* of each side, in system->basis */
    size_t strain_start;   /* S: rows x 3n, row-major */
    size_t gradient_start; /* D_a: n vectors */
    dgfem_real c[12];      /* element: lower halves of w j Hn and w j Hm; edge: ds eta D / h, ds */
    dgfem_vec3 t;          /* normal at rest */
    dgfem_vec3 f1, f2;     /* edge: unit tangent (along element[0] reversed on the boundary), conormal */
    dgfem_real weight;     /* w j, or ds: area or length at rest */
} dgfem_shelli_point;

/* All basis functions at all quadrature points: elements, then sides, then the points of masses. */
enum {
    DGFEM_SHELLI_BASIS_QUAD = 0,
    DGFEM_SHELLI_BASIS_TRIANGLE = 4,
    DGFEM_SHELLI_BASIS_QUAD_SIDES = 7,
    DGFEM_SHELLI_BASIS_TRIANGLE_SIDES = 7 + 4 * DGFEM_SHELLI_EDGE_POINTS,
    DGFEM_SHELLI_BASIS_QUAD_FINE = 7 + 7 * DGFEM_SHELLI_EDGE_POINTS,
    DGFEM_SHELLI_BASIS_TRIANGLE_FINE = DGFEM_SHELLI_BASIS_QUAD_FINE + 9,
    DGFEM_SHELLI_BASIS_COUNT = DGFEM_SHELLI_BASIS_TRIANGLE_FINE + 7
};

struct dgfem_shell_system {
    int group_count, point_count, node_total;
    dgfem_shelli_group *groups;
    dgfem_shelli_point *points;
    int *nodes;
    dgfem_real *strains;
    dgfem_vec3 *gradients;
    size_t *map;              /* value offset of each pair's block in the matrix */
    dgfem_vec3 *group_force;  /* [node_total] of each group on its nodes */
    dgfem_real *group_energy; /* [group_count] */
    dgfem_real *dense;        /* [dense_count][DENSE] stiffness of groups that are computed at a time */
    int dense_count;
    dgfem_mat3 *rotations;     /* [points] of the last evaluation: where F has none, it is kept */
    dgfem_real *strain_before; /* [points][MAX_ROWS] at the beginning of the step, for damping */
    dgfem_shelli_basis basis[DGFEM_SHELLI_BASIS_COUNT];
    dgfem_matrix *matrix;
    dgfem_cholesky *cholesky;
    size_t *diagonal;      /* [nodes] value offset of the diagonal blocks */
    char *held;            /* [nodes] whether any direction is held */
    dgfem_mat3 *free_part; /* [nodes] projector on the directions that are free */
    dgfem_vec3 *target;    /* [nodes] prescribed displacement, in the held directions */
    dgfem_real part;       /* 0..1: how far loads and rotations of supports have gone from `before` to now; else 1 */
    dgfem_real stiffness;  /* largest diagonal of a step's last stiffness, for the round-off of forces */
    dgfem_real *work;      /* DGFEM_SHELLI_VECTORS vectors of all nodes */
};

static void dgfem_shelli_tabulate(dgfem_shelli_basis *basis) {
    dgfem_real weight;
    for (int q = 0; q < 4; q++)
        dgfem_shelli_basis_at(8, dgfem_shelli_quadrature(8, q, &weight), &basis[DGFEM_SHELLI_BASIS_QUAD + q]);
    for (int q = 0; q < 3; q++)
        dgfem_shelli_basis_at(6, dgfem_shelli_quadrature(6, q, &weight), &basis[DGFEM_SHELLI_BASIS_TRIANGLE + q]);
    for (int k = 0; k < 7; k++)
        for (int q = 0; q < DGFEM_SHELLI_EDGE_POINTS; q++) {
            int nodes = k < 4 ? 8 : 6, side = k < 4 ? k : k - 4;
            dgfem_shelli_basis_at(nodes, dgfem_shelli_side(nodes, side, dgfem_shelli_gauss_point(q)),
                                  &basis[DGFEM_SHELLI_BASIS_QUAD_SIDES + DGFEM_SHELLI_EDGE_POINTS * k + q]);
        }
    for (int q = 0; q < 9; q++)
        dgfem_shelli_basis_at(8, dgfem_shelli_fine(8, q, &weight), &basis[DGFEM_SHELLI_BASIS_QUAD_FINE + q]);
    for (int q = 0; q < 7; q++)
        dgfem_shelli_basis_at(6, dgfem_shelli_fine(6, q, &weight), &basis[DGFEM_SHELLI_BASIS_TRIANGLE_FINE + q]);
}

static const dgfem_shelli_basis *dgfem_shelli_fine_basis(const dgfem_shell_system *system, int nodes, int q) {
    return &system->basis[(nodes == 8 ? DGFEM_SHELLI_BASIS_QUAD_FINE : DGFEM_SHELLI_BASIS_TRIANGLE_FINE) + q];
}

/* Area at rest that a fine point stands for. */
static dgfem_real dgfem_shelli_fine_area(const dgfem_shelli_basis *f, const dgfem_vec3 *x, int nodes, int q) {
    dgfem_real weight;
    (void)dgfem_shelli_fine(nodes, q, &weight);
    return weight *
           dgfem_shelli_norm(dgfem_shelli_cross(dgfem_shelli_sum(f->d1, x, nodes), dgfem_shelli_sum(f->d2, x, nodes)));
}

/* Bending stiffness D = E h^3 / (12 (1 - nu^2)) and membrane stiffness E h / (1 - nu^2). */
static dgfem_real dgfem_shelli_bending_stiffness(const dgfem_shell_element *element) {
    const dgfem_material *m = &element->material;
    dgfem_real h = element->thickness;
    return m->young * h * h * h / (12 * (1 - m->poisson * m->poisson));
}
static dgfem_real dgfem_shelli_membrane_stiffness(const dgfem_shell_element *element) {
    const dgfem_material *m = &element->material;
    return m->young * element->thickness / (1 - m->poisson * m->poisson);
}

/* Lower half (00, 10, 11, 20, 21, 22) of H^abcd = nu G^ab G^cd + (1 - nu) / 2 (G^ac G^db + G^ad G^cb) for strains
   11, 22, 2*12. */
static void dgfem_shelli_hooke(const dgfem_shelli_frame *frame, dgfem_real nu, dgfem_real scale, dgfem_real *h) {
    dgfem_real g11 = dgfem_shelli_dot(frame->c1, frame->c1), g22 = dgfem_shelli_dot(frame->c2, frame->c2);
    dgfem_real g12 = dgfem_shelli_dot(frame->c1, frame->c2), half = (1 - nu) / 2;
    h[0] = scale * g11 * g11;
    h[1] = scale * (nu * g11 * g22 + 2 * half * g12 * g12);
    h[2] = scale * g22 * g22;
    h[3] = scale * g11 * g12;
    h[4] = scale * g22 * g12;
    h[5] = scale * (nu * g12 * g12 + half * (g11 * g22 + g12 * g12));
}

static void dgfem_shelli_set_row(dgfem_real *row, int a, dgfem_vec3 v) {
    row[3 * a] = v.x, row[3 * a + 1] = v.y, row[3 * a + 2] = v.z;
}

/* One row of the membrane strain: e_ab of a node, with twice the shear for 12. */
static void dgfem_shelli_membrane_rows(const dgfem_shelli_basis *f, const dgfem_shelli_frame *frame, int n,
                                       dgfem_real *rows) {
    for (int a = 0; a < n; a++) {
        dgfem_shelli_set_row(rows, a, dgfem_shelli_scale(f->d1[a], frame->e1));
        dgfem_shelli_set_row(rows + 3 * n, a, dgfem_shelli_scale(f->d2[a], frame->e2));
        dgfem_shelli_set_row(rows + 6 * n, a,
                             dgfem_shelli_axpy(dgfem_shelli_scale(f->d2[a], frame->e1), f->d1[a], frame->e2));
    }
}

/* One row of the bending strain rho_ab = -delta(phi_ab . t), for the second derivative phi_ab = `second` and that of
   the shape functions `d`, times `factor`; eq. (28). */
static void dgfem_shelli_bending_row(const dgfem_shelli_basis *f, const dgfem_shelli_frame *frame, dgfem_vec3 second,
                                     const dgfem_real *d, dgfem_real factor, int n, dgfem_real *row) {
    dgfem_real curvature = dgfem_shelli_dot(second, frame->t);
    dgfem_vec3 u =
        dgfem_shelli_axpy(dgfem_shelli_cross(second, frame->e2), curvature, dgfem_shelli_cross(frame->e2, frame->t));
    dgfem_vec3 v =
        dgfem_shelli_axpy(dgfem_shelli_cross(second, frame->e1), curvature, dgfem_shelli_cross(frame->e1, frame->t));
    for (int a = 0; a < n; a++) {
        dgfem_vec3 b = dgfem_shelli_scale(f->d1[a] / frame->j, u);
        b = dgfem_shelli_axpy(b, -f->d2[a] / frame->j, v);
        b = dgfem_shelli_axpy(b, -d[a], frame->t);
        dgfem_shelli_set_row(row, a, dgfem_shelli_scale(factor, b));
    }
}

static void dgfem_shelli_bending_rows(const dgfem_shelli_basis *f, const dgfem_shelli_frame *frame, int n,
                                      dgfem_real *rows) {
    dgfem_shelli_bending_row(f, frame, frame->e11, f->d11, 1, n, rows);
    dgfem_shelli_bending_row(f, frame, frame->e22, f->d22, 1, n, rows + 3 * n);
    dgfem_shelli_bending_row(f, frame, frame->e12, f->d12, 2, n, rows + 6 * n);
}

static dgfem_status dgfem_shelli_fail_degenerate(const dgfem_shell *shell, int element) {
    return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "element %d has no tangent plane", element);
}

/* Fills in the points of one element. */
static dgfem_status dgfem_shelli_build_element(const dgfem_shell *shell, dgfem_shell_system *system,
                                               const dgfem_shelli_group *group) {
    const dgfem_shell_element *element = &shell->elements[group->owner];
    int n = element->node_count;
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_gather(shell->rest, element->node, n, x);
    for (int q = 0; q < group->point_count; q++) {
        dgfem_shelli_point *point = &system->points[group->point_start + q];
        dgfem_shelli_frame frame;
        dgfem_real weight;
        point->basis[0] = (n == 8 ? DGFEM_SHELLI_BASIS_QUAD : DGFEM_SHELLI_BASIS_TRIANGLE) + q;
        const dgfem_shelli_basis *f = &system->basis[point->basis[0]];
        (void)dgfem_shelli_quadrature(n, q, &weight);
        if (!dgfem_shelli_frame_at(f, x, n, &frame)) return dgfem_shelli_fail_degenerate(shell, group->owner);
        dgfem_real *s = system->strains + point->strain_start;
        dgfem_vec3 *gradient = system->gradients + point->gradient_start;
        point->weight = weight * frame.j;
        point->t = frame.t;
        point->f1 = dgfem_shelli_unit(frame.e1);
        point->f2 = dgfem_shelli_cross(frame.t, point->f1);
        dgfem_shelli_membrane_rows(f, &frame, n, s);
        dgfem_shelli_bending_rows(f, &frame, n, s + 9 * n);
        dgfem_shelli_hooke(&frame, element->material.poisson, point->weight * dgfem_shelli_membrane_stiffness(element),
                           point->c);
        dgfem_shelli_hooke(&frame, element->material.poisson, point->weight * dgfem_shelli_bending_stiffness(element),
                           point->c + 6);
        for (int a = 0; a < n; a++)
            gradient[a] = dgfem_shelli_axpy(dgfem_shelli_scale(f->d1[a], frame.c1), f->d2[a], frame.c2);
    }
    return DGFEM_OK;
}

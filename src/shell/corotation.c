#pragma once
#include "edge.c"
/* Forces and tangents at large rotations: every quadrature point sees the shell through its own rotation.

     u~ = R^T x - X,   f += R S^T C S u~,   K_frozen += R S^T C S R^T

   and, R following x: with F = sum x_a D_a^T + t t0^T = R U, body-frame spin w (dR = R [w]x),
     w = sum W_a dx_a,  W_a = (tr(U) I - U)^-1 ([D_a]x R^T + [t0]x R^T dt/dx_a),
     K_tangent += R S^T C (S R^T + S [y]x W) - R [p]x W,  y_a = R^T x_a,  p_a = (S^T C S u~)_a,
   whose asymmetry is of second order in the strains. */

/* A group's nodes, relative to the first: rigid translations then cost no digits. */
typedef struct dgfem_shelli_local {
    int count;
    const int *nodes;
    dgfem_vec3 x[DGFEM_SHELLI_MAX_GROUP], rest[DGFEM_SHELLI_MAX_GROUP];
} dgfem_shelli_local;

typedef struct dgfem_shelli_kinematics {
    int rows;
    dgfem_mat3 r;
    dgfem_vec3 y[DGFEM_SHELLI_MAX_GROUP]; /* R^T x */
    dgfem_real strain[DGFEM_SHELLI_MAX_ROWS];
    dgfem_real stress[DGFEM_SHELLI_MAX_ROWS]; /* C strain, weight included */
    dgfem_vec3 force[DGFEM_SHELLI_MAX_GROUP]; /* p_a, rotated frame */
    dgfem_mat3 spin[DGFEM_SHELLI_MAX_GROUP];  /* W_a; only where asked for */
} dgfem_shelli_kinematics;

static void dgfem_shelli_local_take(const dgfem_shell *shell, const dgfem_shelli_group *group, const dgfem_vec3 *x,
                                    dgfem_shelli_local *local) {
    local->count = group->node_count;
    local->nodes = shell->system->nodes + group->node_start;
    for (int a = 0; a < group->node_count; a++) {
        local->x[a] = dgfem_shelli_sub(x[local->nodes[a]], x[local->nodes[0]]);
        local->rest[a] = dgfem_shelli_sub(shell->rest[local->nodes[a]], shell->rest[local->nodes[0]]);
    }
}

/* ---- the normal and its derivative ---- */

/* Current base vectors of one side. */
static void dgfem_shelli_side_bases(const dgfem_shelli_group *group, const dgfem_shelli_basis *f, int side, int nodes,
                                    const dgfem_shelli_local *local, dgfem_vec3 *e1, dgfem_vec3 *e2) {
    *e1 = *e2 = dgfem_shelli_vec3(0, 0, 0);
    for (int a = 0; a < nodes; a++) {
        dgfem_vec3 x = local->x[group->local[side][a]];
        *e1 = dgfem_shelli_axpy(*e1, f->d1[a], x);
        *e2 = dgfem_shelli_axpy(*e2, f->d2[a], x);
    }
}

/* m = (I - t t^T) m / length */
static dgfem_mat3 dgfem_shelli_tangential(dgfem_vec3 t, dgfem_real length, const dgfem_mat3 *m) {
    dgfem_mat3 p = dgfem_shelli_identity();
    dgfem_shelli_add_outer(&p, -1, t, t);
    p = dgfem_shelli_multiply3(&p, m);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) p.m[i][j] /= length;
    return p;
}

/* The unit normal (of both sides: of the mean). With `slope` its derivatives by all nodes. */
static dgfem_vec3 dgfem_shelli_normal(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                      const dgfem_shelli_point *point, const dgfem_shelli_local *local,
                                      dgfem_mat3 *slope) {
    dgfem_vec3 sum = dgfem_shelli_vec3(0, 0, 0);
    if (slope) memset(slope, 0, (size_t)local->count * sizeof *slope);
    for (int side = 0; side < group->sides; side++) {
        const dgfem_shelli_basis *f = &shell->system->basis[point->basis[side]];
        int nodes = shell->elements[group->element[side]].node_count;
        dgfem_vec3 e1, e2;
        dgfem_shelli_side_bases(group, f, side, nodes, local, &e1, &e2);
        dgfem_vec3 n = dgfem_shelli_cross(e1, e2), t = dgfem_shelli_unit(n);
        sum = dgfem_shelli_add(sum, t);
        dgfem_real length = dgfem_shelli_norm(n);
        if (!slope || !(length > 0)) continue;
        dgfem_mat3 along1 = dgfem_shelli_cross_matrix(e1), along2 = dgfem_shelli_cross_matrix(e2);
        along1 = dgfem_shelli_tangential(t, length, &along1);
        along2 = dgfem_shelli_tangential(t, length, &along2);
        for (int a = 0; a < nodes; a++) {
            dgfem_mat3 *out = &slope[group->local[side][a]];
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) out->m[i][j] += f->d2[a] * along1.m[i][j] - f->d1[a] * along2.m[i][j];
        }
    }
    if (group->sides == 1) return sum;
    dgfem_real length = dgfem_shelli_norm(sum);
    sum = dgfem_shelli_unit(sum);
    for (int a = 0; slope && length > 0 && a < local->count; a++)
        slope[a] = dgfem_shelli_tangential(sum, length, &slope[a]);
    return sum;
}

/* ---- rotations ---- */

/* Polar rotation of a matrix that is close to one, by Newton's iteration R <- (R + R^-T) / 2; the public function takes
   the hard cases. */
static dgfem_mat3 dgfem_shelli_polar(const dgfem_mat3 *f, const dgfem_mat3 *fallback) {
    dgfem_mat3 r = *f;
    for (int sweep = 0; sweep < 12; sweep++) {
        dgfem_vec3 row[3], c[3];
        dgfem_real change = 0;
        for (int i = 0; i < 3; i++) row[i] = dgfem_shelli_vec3(r.m[i][0], r.m[i][1], r.m[i][2]);
        for (int i = 0; i < 3; i++) c[i] = dgfem_shelli_cross(row[(i + 1) % 3], row[(i + 2) % 3]);
        dgfem_real det = dgfem_shelli_dot(row[0], c[0]);
        if (!(det > DGFEM_R(0.01)) || !(det < 100)) break;
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 next = dgfem_shelli_scale(DGFEM_R(0.5), dgfem_shelli_axpy(row[i], 1 / det, c[i]));
            dgfem_vec3 moved = dgfem_shelli_sub(next, row[i]);
            change += dgfem_shelli_dot(moved, moved);
            r.m[i][0] = next.x, r.m[i][1] = next.y, r.m[i][2] = next.z;
        }
        if (change < DGFEM_SHELL_EPSILON) return r; /* the next error would be its square */
    }
    return dgfem_rotation_of(*f, *fallback);
}

/* The spin of R: axial vectors [D_a]x R^T + [t0]x R^T dt/dx_a, through (tr(U) I - U)^-1. */
static void dgfem_shelli_spins(const dgfem_shelli_point *point, const dgfem_vec3 *gradient, const dgfem_mat3 *f,
                               const dgfem_mat3 *slope, int count, dgfem_shelli_kinematics *k) {
    dgfem_mat3 rt = dgfem_shelli_transposed(&k->r), u = dgfem_shelli_multiply3(&rt, f), y;
    dgfem_real trace = u.m[0][0] + u.m[1][1] + u.m[2][2];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) u.m[i][j] = u.m[j][i] = -DGFEM_R(0.5) * (u.m[i][j] + u.m[j][i]);
    for (int i = 0; i < 3; i++) u.m[i][i] += trace;
    if (!dgfem_shelli_invert(&u, &y)) memset(&y, 0, sizeof y);
    dgfem_mat3 t0 = dgfem_shelli_cross_matrix(point->t);
    t0 = dgfem_shelli_multiply3(&t0, &rt);
    for (int a = 0; a < count; a++) {
        dgfem_mat3 axial = dgfem_shelli_cross_matrix(gradient[a]), tilt = dgfem_shelli_multiply3(&t0, &slope[a]);
        axial = dgfem_shelli_multiply3(&axial, &rt);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) axial.m[i][j] += tilt.m[i][j];
        k->spin[a] = dgfem_shelli_multiply3(&y, &axial);
    }
}

/* R of the point, and with `spins` its derivative. */
static void dgfem_shelli_rotate(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                const dgfem_shelli_point *point, const dgfem_shelli_local *local, int spins,
                                dgfem_shelli_kinematics *k) {
    const dgfem_vec3 *gradient = shell->system->gradients + point->gradient_start;
    dgfem_mat3 *last = &shell->system->rotations[point - shell->system->points];
    dgfem_mat3 slope[DGFEM_SHELLI_MAX_GROUP], f;
    memset(&f, 0, sizeof f);
    dgfem_vec3 t = dgfem_shelli_normal(shell, group, point, local, spins ? slope : NULL);
    for (int a = 0; a < local->count; a++) dgfem_shelli_add_outer(&f, 1, local->x[a], gradient[a]);
    dgfem_shelli_add_outer(&f, 1, t, point->t);
    k->r = *last = dgfem_shelli_polar(&f, last);
    if (spins) dgfem_shelli_spins(point, gradient, &f, slope, local->count, k);
}

/* Symmetry plane: R turns about its normal n, from the rest tangent to the current one. */
static void dgfem_shelli_rotate_in_plane(const dgfem_shell *shell, const dgfem_shelli_point *point,
                                         const dgfem_shelli_local *local, dgfem_vec3 n, int spins,
                                         dgfem_shelli_kinematics *k) {
    const dgfem_vec3 *gradient = shell->system->gradients + point->gradient_start;
    dgfem_vec3 tangent = dgfem_shelli_vec3(0, 0, 0);
    for (int a = 0; a < local->count; a++)
        tangent = dgfem_shelli_axpy(tangent, dgfem_shelli_dot(gradient[a], point->f1), local->x[a]);
    dgfem_vec3 ahead = dgfem_shelli_cross(n, tangent);
    dgfem_real square = dgfem_shelli_dot(ahead, ahead);
    if (!(square > 0)) return;
    dgfem_vec3 ahead_rest = dgfem_shelli_cross(n, point->f1);
    dgfem_real c = dgfem_shelli_dot(ahead, ahead_rest), s = dgfem_shelli_dot(tangent, ahead_rest);
    k->r = dgfem_shelli_rotation(n, (dgfem_real)atan2((double)s, (double)c));
    for (int a = 0; spins && a < local->count; a++)
        dgfem_shelli_add_outer(&k->spin[a], dgfem_shelli_dot(gradient[a], point->f1) / square, n, ahead);
}

/* What a condition has come to on the path of a static solve; elsewhere simply its value. */
static dgfem_real dgfem_shelli_scalar_now(const dgfem_shell *shell, const dgfem_shell_condition *condition) {
    if (shell->system->part == 1) return condition->scalar;
    return condition->scalar_before + shell->system->part * (condition->scalar - condition->scalar_before);
}
static dgfem_vec3 dgfem_shelli_between(const dgfem_shell *shell, dgfem_vec3 before, dgfem_vec3 now) {
    if (shell->system->part == 1) return now;
    return dgfem_shelli_axpy(before, shell->system->part, dgfem_shelli_sub(now, before));
}
static dgfem_vec3 dgfem_shelli_vector_now(const dgfem_shell *shell, const dgfem_shell_condition *condition) {
    return dgfem_shelli_between(shell, condition->vector_before, condition->vector);
}

/* A rigid motion x -> r x + t. */
typedef struct dgfem_shelli_placement {
    dgfem_mat3 r;
    dgfem_vec3 t;
} dgfem_shelli_placement;

static dgfem_vec3 dgfem_shelli_place(const dgfem_shelli_placement *placement, dgfem_vec3 x) {
    return dgfem_shelli_add(dgfem_shelli_multiply(&placement->r, x), placement->t);
}

static dgfem_shelli_placement dgfem_shelli_clamp_before(const dgfem_shell_condition *clamp) {
    dgfem_shelli_placement before;
    before.r = clamp->rotation_before, before.t = clamp->vector_before;
    return before;
}

/* Where a clamp is at the present part s of the path: between two placements lies a screw motion, whatever origin they
   are given from. With turn angle w about the axis a and move d = d_a + d_n (along and across the axis), the part s
   turns by s w and moves by
     s d_a + sin(s w / 2) / sin(w / 2) (cos v d_n + sin v (a x d_n)),  v = (s - 1) w / 2. */
static dgfem_shelli_placement dgfem_shelli_clamp_now(const dgfem_shell *shell, const dgfem_shell_condition *clamp) {
    dgfem_shelli_placement now = dgfem_shelli_clamp_before(clamp);
    dgfem_real s = shell->system->part, angle;
    if (s == 1) {
        now.r = clamp->rotation, now.t = clamp->vector;
        return now;
    }
    dgfem_mat3 back = dgfem_shelli_transposed(&now.r), turn = dgfem_shelli_multiply3(&clamp->rotation, &back);
    dgfem_vec3 a = dgfem_shelli_axis_of(&turn, &angle);
    dgfem_vec3 d = dgfem_shelli_sub(clamp->vector, dgfem_shelli_multiply(&turn, now.t));
    dgfem_vec3 along = dgfem_shelli_scale(dgfem_shelli_dot(a, d), a), across = dgfem_shelli_sub(d, along);
    double half = (double)angle / 2, v = ((double)s - 1) * half;
    dgfem_real part = half > 0 ? (dgfem_real)(sin((double)s * half) / sin(half)) : s;
    turn = dgfem_shelli_rotation(a, s * angle);
    d = dgfem_shelli_axpy(dgfem_shelli_scale(s, along), part * (dgfem_real)cos(v), across);
    d = dgfem_shelli_axpy(d, part * (dgfem_real)sin(v), dgfem_shelli_cross(a, across));
    now.r = dgfem_shelli_multiply3(&turn, &now.r);
    now.t = dgfem_shelli_add(dgfem_shelli_multiply(&turn, now.t), d);
    return now;
}

/* R of a held boundary edge, and the tilt that it prescribes where rotations are not followed. */
static dgfem_real dgfem_shelli_rotate_support(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                              const dgfem_shelli_point *point, const dgfem_shelli_local *local,
                                              int spins, dgfem_shelli_kinematics *k) {
    if (spins) memset(k->spin, 0, (size_t)local->count * sizeof *k->spin);
    dgfem_mat3 turn = dgfem_shelli_identity();
    if (condition->kind == DGFEM_SHELL_CONDITION_CLAMP) turn = dgfem_shelli_clamp_now(shell, condition).r;
    if (condition->kind == DGFEM_SHELL_CONDITION_ROTATION)
        turn = dgfem_shelli_rotation(point->f1,
                                     -dgfem_shelli_scalar_now(shell, condition)); /* f1 runs against the element */
    k->r = turn;
    if (condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY && shell->desc.corotational)
        dgfem_shelli_rotate_in_plane(shell, point, local, condition->vector, spins, k);
    if (shell->desc.corotational) return 0;
    k->r = dgfem_shelli_identity();
    if (condition->kind == DGFEM_SHELL_CONDITION_ROTATION) return dgfem_shelli_scalar_now(shell, condition);
    return dgfem_shelli_dot(point->f2, dgfem_shelli_multiply(&turn, point->t));
}

/* ---- strains and stresses ---- */

static int dgfem_shelli_rows(const dgfem_shelli_group *group) { return group->kind == DGFEM_SHELLI_ELEMENT ? 6 : 2; }

/* out = C in, for one vector of the point's rows with the given stride between rows. */
static void dgfem_shelli_apply_stiffness(const dgfem_shelli_point *point, int rows, const dgfem_real *in,
                                         dgfem_real *out) {
    const dgfem_real *c = point->c;
    if (rows == 2) {
        out[0] = c[0] * in[0] + c[1] * in[1];
        out[1] = c[1] * in[0];
        return;
    }
    for (int i = 0; i < 6; i += 3, c += 6) {
        out[i] = c[0] * in[i] + c[1] * in[i + 1] + c[3] * in[i + 2];
        out[i + 1] = c[1] * in[i] + c[2] * in[i + 1] + c[4] * in[i + 2];
        out[i + 2] = c[3] * in[i] + c[4] * in[i + 1] + c[5] * in[i + 2];
    }
}

static dgfem_real dgfem_shelli_row_product(const dgfem_real *row, const dgfem_vec3 *u, int count) {
    dgfem_real sum = 0;
    for (int a = 0; a < count; a++) sum += row[3 * a] * u[a].x + row[3 * a + 1] * u[a].y + row[3 * a + 2] * u[a].z;
    return sum;
}

/* p_a = sum over rows of S_a^T stress. */
static void dgfem_shelli_point_forces(const dgfem_real *s, int rows, const dgfem_real *stress, int count,
                                      dgfem_vec3 *force) {
    for (int a = 0; a < count; a++) force[a] = dgfem_shelli_vec3(0, 0, 0);
    for (int i = 0; i < rows; i++)
        for (int a = 0; a < count; a++) {
            const dgfem_real *b = s + (3 * i * count + 3 * a);
            force[a] = dgfem_shelli_axpy(force[a], stress[i], dgfem_shelli_vec3(b[0], b[1], b[2]));
        }
}

/* Whether a group acts: one of a boundary edge does where a condition holds the edge. */
static int dgfem_shelli_group_acts(const dgfem_shell *shell, const dgfem_shelli_group *group) {
    return group->kind != DGFEM_SHELLI_BOUNDARY || shell->edges[group->owner].support != DGFEM_NONE;
}

/* Everything about a point in the state of `local`. */
static void dgfem_shelli_evaluate(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                  const dgfem_shelli_point *point, const dgfem_shelli_local *local, int spins,
                                  dgfem_shelli_kinematics *k) {
    const dgfem_real *s = shell->system->strains + point->strain_start;
    dgfem_vec3 u[DGFEM_SHELLI_MAX_GROUP];
    dgfem_real prescribed = 0;
    k->rows = dgfem_shelli_rows(group);
    if (group->kind == DGFEM_SHELLI_BOUNDARY) {
        prescribed = dgfem_shelli_rotate_support(shell, &shell->conditions[shell->edges[group->owner].support], point,
                                                 local, spins, k);
    } else if (shell->desc.corotational) {
        dgfem_shelli_rotate(shell, group, point, local, spins, k);
    } else {
        k->r = dgfem_shelli_identity();
        if (spins) memset(k->spin, 0, (size_t)local->count * sizeof *k->spin);
    }
    for (int a = 0; a < local->count; a++) {
        k->y[a] = dgfem_shelli_multiply_transposed(&k->r, local->x[a]);
        u[a] = dgfem_shelli_sub(k->y[a], local->rest[a]);
    }
    for (int i = 0; i < k->rows; i++)
        k->strain[i] = dgfem_shelli_row_product(s + 3 * i * local->count, u, local->count);
    if (k->rows == 2) k->strain[0] += prescribed;
    dgfem_shelli_apply_stiffness(point, k->rows, k->strain, k->stress);
    dgfem_shelli_point_forces(s, k->rows, k->stress, local->count, k->force);
}

/* ---- internal force ---- */

/* Groups are evaluated in any order, each into memory of its own; sums are then taken in theirs. So results are the
   same bits for any number of threads. */
typedef struct dgfem_shelli_pass {
    const dgfem_shell *shell;
    const dgfem_vec3 *x;
    dgfem_real damping; /* forces */
    int spins, first;   /* tangents: the group of the first matrix */
    dgfem_real frozen;
} dgfem_shelli_pass;

static void dgfem_shelli_run(const dgfem_hooks *hooks, int count, dgfem_range_fn fn, dgfem_shelli_pass *pass) {
    enum { GRAIN = 8 };
    if (hooks->parallel_for && count > GRAIN) hooks->parallel_for(hooks->parallel_for_user, count, GRAIN, fn, pass);
    else fn(pass, 0, count);
}

/* Strains of a point at the beginning of the step. */
static dgfem_real *dgfem_shelli_strain_before(const dgfem_shell_system *system, const dgfem_shelli_point *point) {
    return system->strain_before + DGFEM_SHELLI_MAX_ROWS * (size_t)(point - system->points);
}

static void dgfem_shelli_strain_range(void *context, int first, int last) {
    const dgfem_shelli_pass *pass = (const dgfem_shelli_pass *)context;
    const dgfem_shell_system *system = pass->shell->system;
    dgfem_shelli_local local;
    dgfem_shelli_kinematics k;
    for (int g = first; g < last; g++) {
        const dgfem_shelli_group *group = &system->groups[g];
        if (!dgfem_shelli_group_acts(pass->shell, group)) continue;
        dgfem_shelli_local_take(pass->shell, group, pass->x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &system->points[group->point_start + q];
            dgfem_shelli_evaluate(pass->shell, group, point, &local, 0, &k);
            memcpy(dgfem_shelli_strain_before(system, point), k.strain, (size_t)k.rows * sizeof *k.strain);
        }
    }
}

/* Keeps the strains of the current positions, supports where they were before. */
static void dgfem_shelli_keep_strains(const dgfem_shell *shell) {
    dgfem_shelli_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.shell = shell, pass.x = shell->position;
    shell->system->part = 0;
    dgfem_shelli_run(&shell->hooks, shell->system->group_count, dgfem_shelli_strain_range, &pass);
    shell->system->part = 1;
}

/* Adds the damping C times `damping` = beta / h times what the strains have gained in the step of length h: nothing in
   a rigid motion, however large, with its supports. */
static void dgfem_shelli_add_damping(const dgfem_shell *shell, const dgfem_shelli_point *point, dgfem_real damping,
                                     int count, dgfem_shelli_kinematics *k) {
    const dgfem_real *before = dgfem_shelli_strain_before(shell->system, point);
    dgfem_real gain[DGFEM_SHELLI_MAX_ROWS], stress[DGFEM_SHELLI_MAX_ROWS];
    for (int i = 0; i < k->rows; i++) gain[i] = damping * (k->strain[i] - before[i]);
    dgfem_shelli_apply_stiffness(point, k->rows, gain, stress);
    for (int i = 0; i < k->rows; i++) stress[i] += k->stress[i];
    dgfem_shelli_point_forces(shell->system->strains + point->strain_start, k->rows, stress, count, k->force);
}

static void dgfem_shelli_group_force(const dgfem_shelli_pass *pass, int g) {
    const dgfem_shell_system *system = pass->shell->system;
    const dgfem_shelli_group *group = &system->groups[g];
    dgfem_vec3 *force = system->group_force + group->node_start;
    dgfem_shelli_local local;
    dgfem_shelli_kinematics k;
    dgfem_real energy = 0;
    memset(force, 0, (size_t)group->node_count * sizeof *force);
    system->group_energy[g] = 0;
    if (!dgfem_shelli_group_acts(pass->shell, group)) return;
    dgfem_shelli_local_take(pass->shell, group, pass->x, &local);
    for (int q = 0; q < group->point_count; q++) {
        const dgfem_shelli_point *point = &system->points[group->point_start + q];
        dgfem_shelli_evaluate(pass->shell, group, point, &local, 0, &k);
        for (int i = 0; i < k.rows; i++) energy += DGFEM_R(0.5) * k.strain[i] * k.stress[i];
        if (pass->damping > 0) dgfem_shelli_add_damping(pass->shell, point, pass->damping, local.count, &k);
        for (int a = 0; a < local.count; a++)
            force[a] = dgfem_shelli_add(force[a], dgfem_shelli_multiply(&k.r, k.force[a]));
    }
    system->group_energy[g] = energy;
}

static void dgfem_shelli_force_range(void *context, int first, int last) {
    for (int g = first; g < last; g++) dgfem_shelli_group_force((const dgfem_shelli_pass *)context, g);
}

/* out += factor * internal force at positions x, with the given damping of the strains' gain; returns the elastic
   energy. */
static dgfem_real dgfem_shelli_add_internal(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real damping,
                                            dgfem_real factor, dgfem_vec3 *out) {
    const dgfem_shell_system *system = shell->system;
    dgfem_shelli_pass pass;
    dgfem_real energy = 0;
    memset(&pass, 0, sizeof pass);
    pass.shell = shell, pass.x = x, pass.damping = damping;
    dgfem_shelli_run(&shell->hooks, system->group_count, dgfem_shelli_force_range, &pass);
    for (int g = 0; g < system->group_count; g++) {
        const dgfem_shelli_group *group = &system->groups[g];
        energy += system->group_energy[g];
        for (int i = group->node_start; out && i < group->node_start + group->node_count; i++) {
            dgfem_vec3 *to = &out[system->nodes[i]];
            *to = dgfem_shelli_axpy(*to, factor, system->group_force[i]);
        }
    }
    return energy;
}

/* ---- tangent ---- */

enum { DGFEM_SHELLI_MAX_TERMS = DGFEM_SHELLI_MAX_ROWS + 3 };

/* S [y]x: what a spin does to the strains, rows x 3. */
static void dgfem_shelli_spin_strains(const dgfem_real *s, int rows, const dgfem_vec3 *y, int count, dgfem_real *out) {
    for (int i = 0; i < rows; i++) {
        dgfem_vec3 sum = dgfem_shelli_vec3(0, 0, 0); /* b^T [y]x = (b x y)^T */
        for (int a = 0; a < count; a++) {
            const dgfem_real *b = s + (3 * i * count + 3 * a);
            sum = dgfem_shelli_add(sum, dgfem_shelli_cross(dgfem_shelli_vec3(b[0], b[1], b[2]), y[a]));
        }
        out[3 * i] = sum.x, out[3 * i + 1] = sum.y, out[3 * i + 2] = sum.z;
    }
}

/* The stiffness of a point as a product left^T right of `terms` rows each. Rows 0 .. rows - 1: S R^T and C (frozen S
   R^T + S [y]x W), where frozen is 1 without damping. With spins three more: -(R [p]x)^T and W. Returns the number of
   terms. */
static int dgfem_shelli_point_terms(const dgfem_shell *shell, const dgfem_shelli_point *point,
                                    const dgfem_shelli_kinematics *k, int count, int spins, dgfem_real frozen,
                                    dgfem_real *left, dgfem_real *right) {
    const dgfem_real *s = shell->system->strains + point->strain_start;
    int width = 3 * count, rows = k->rows;
    dgfem_real turned[3 * DGFEM_SHELLI_MAX_ROWS], in[DGFEM_SHELLI_MAX_ROWS] = {0}, out[DGFEM_SHELLI_MAX_ROWS];
    for (int i = 0; i < rows; i++)
        for (int a = 0; a < count; a++) {
            const dgfem_real *b = s + i * width + 3 * a;
            dgfem_vec3 v = dgfem_shelli_multiply(&k->r, dgfem_shelli_vec3(b[0], b[1], b[2]));
            dgfem_shelli_set_row(left + i * width, a, v);
        }
    for (int i = 0; i < rows * width; i++) right[i] = frozen * left[i];
    if (spins) {
        dgfem_shelli_spin_strains(s, rows, k->y, count, turned);
        for (int a = 0; a < count; a++) {
            const dgfem_mat3 *w = &k->spin[a];
            dgfem_mat3 p = dgfem_shelli_cross_matrix(k->force[a]);
            p = dgfem_shelli_multiply3(&k->r, &p);
            for (int j = 0; j < 3; j++) {
                for (int i = 0; i < rows; i++)
                    right[i * width + 3 * a + j] +=
                        turned[3 * i] * w->m[0][j] + turned[3 * i + 1] * w->m[1][j] + turned[3 * i + 2] * w->m[2][j];
                for (int i = 0; i < 3; i++) {
                    left[(rows + i) * width + 3 * a + j] = -p.m[j][i];
                    right[(rows + i) * width + 3 * a + j] = w->m[i][j];
                }
            }
        }
    }
    for (int c = 0; c < width; c++) {
        for (int i = 0; i < rows; i++) in[i] = right[i * width + c];
        dgfem_shelli_apply_stiffness(point, rows, in, out);
        for (int i = 0; i < rows; i++) right[i * width + c] = out[i];
    }
    return spins ? rows + 3 : rows;
}

/* out += factor * K_tangent direction, exactly. */
static void dgfem_shelli_add_tangent_product(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *direction,
                                             dgfem_vec3 *out) {
    const dgfem_shell_system *system = shell->system;
    dgfem_real left[DGFEM_SHELLI_MAX_TERMS * DGFEM_SHELLI_MAX_WIDTH];
    dgfem_real right[DGFEM_SHELLI_MAX_TERMS * DGFEM_SHELLI_MAX_WIDTH];
    dgfem_vec3 d[DGFEM_SHELLI_MAX_GROUP];
    dgfem_shelli_local local;
    dgfem_shelli_kinematics k;
    for (int g = 0; g < system->group_count; g++) {
        const dgfem_shelli_group *group = &system->groups[g];
        if (!dgfem_shelli_group_acts(shell, group)) continue;
        dgfem_shelli_local_take(shell, group, x, &local);
        dgfem_shelli_gather(direction, local.nodes, local.count, d);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &system->points[group->point_start + q];
            dgfem_shelli_evaluate(shell, group, point, &local, 1, &k);
            int terms = dgfem_shelli_point_terms(shell, point, &k, local.count, 1, 1, left, right);
            for (int i = 0; i < terms; i++) {
                dgfem_real value = dgfem_shelli_row_product(right + 3 * i * local.count, d, local.count);
                for (int a = 0; a < local.count; a++) {
                    const dgfem_real *b = left + (3 * i * local.count + 3 * a);
                    dgfem_vec3 *to = &out[local.nodes[a]];
                    *to = dgfem_shelli_axpy(*to, value, dgfem_shelli_vec3(b[0], b[1], b[2]));
                }
            }
        }
    }
}

/* dense += left^T right, `width` columns. */
static void dgfem_shelli_add_products(const dgfem_real *left, const dgfem_real *right, int terms, int width,
                                      dgfem_real *dense) {
    for (int i = 0; i < width; i++) {
        dgfem_real *row = dense + i * width;
        for (int k = 0; k < terms; k++) {
            const dgfem_real factor = left[k * width + i], *from = right + k * width;
            for (int j = 0; j < width; j++) row[j] += factor * from[j];
        }
    }
}

/* Adds factor times the symmetric part of a group's dense matrix to the block matrix. */
static void dgfem_shelli_scatter(const dgfem_shell_system *system, const dgfem_shelli_group *group, dgfem_real factor,
                                 const dgfem_real *dense) {
    const int *nodes = system->nodes + group->node_start;
    const size_t *map = system->map + group->map_start;
    int width = 3 * group->node_count;
    factor *= DGFEM_R(0.5);
    for (int a = 0; a < group->node_count; a++)
        for (int b = 0; b <= a; b++) {
            dgfem_real *block = system->matrix->values + *map++;
            int row = nodes[a] >= nodes[b] ? a : b, column = nodes[a] >= nodes[b] ? b : a;
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    block[3 * i + j] += factor * (dense[(3 * row + i) * width + 3 * column + j] +
                                                  dense[(3 * column + j) * width + 3 * row + i]);
        }
}

/* The stiffness of a group, width x width. */
static void dgfem_shelli_group_stiffness(const dgfem_shelli_pass *pass, int g, dgfem_real *dense) {
    const dgfem_shell_system *system = pass->shell->system;
    const dgfem_shelli_group *group = &system->groups[g];
    dgfem_real left[DGFEM_SHELLI_MAX_TERMS * DGFEM_SHELLI_MAX_WIDTH];
    dgfem_real right[DGFEM_SHELLI_MAX_TERMS * DGFEM_SHELLI_MAX_WIDTH];
    dgfem_shelli_local local;
    dgfem_shelli_kinematics k;
    int width = 3 * group->node_count;
    if (!dgfem_shelli_group_acts(pass->shell, group)) return;
    dgfem_shelli_local_take(pass->shell, group, pass->x, &local);
    memset(dense, 0, (size_t)(width * width) * sizeof *dense);
    for (int q = 0; q < group->point_count; q++) {
        const dgfem_shelli_point *point = &system->points[group->point_start + q];
        dgfem_shelli_evaluate(pass->shell, group, point, &local, pass->spins, &k);
        int terms =
            dgfem_shelli_point_terms(pass->shell, point, &k, local.count, pass->spins, pass->frozen, left, right);
        dgfem_shelli_add_products(left, right, terms, width, dense);
    }
}

static void dgfem_shelli_stiffness_range(void *context, int first, int last) {
    const dgfem_shelli_pass *pass = (const dgfem_shelli_pass *)context;
    for (int i = first; i < last; i++)
        dgfem_shelli_group_stiffness(pass, pass->first + i,
                                     pass->shell->system->dense + (size_t)i * DGFEM_SHELLI_DENSE);
}

/* matrix += factor * K_frozen, or with spins the symmetric part of K_tangent, where the part of frozen rotations counts
   `frozen` times. */
static void dgfem_shelli_assemble(const dgfem_shell *shell, const dgfem_vec3 *x, int spins, dgfem_real frozen,
                                  dgfem_real factor) {
    const dgfem_shell_system *system = shell->system;
    dgfem_shelli_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.shell = shell, pass.x = x, pass.spins = spins, pass.frozen = frozen;
    for (; pass.first < system->group_count; pass.first += system->dense_count) {
        int count = system->group_count - pass.first;
        if (count > system->dense_count) count = system->dense_count;
        dgfem_shelli_run(&shell->hooks, count, dgfem_shelli_stiffness_range, &pass);
        for (int i = 0; i < count; i++) {
            const dgfem_shelli_group *group = &system->groups[pass.first + i];
            if (dgfem_shelli_group_acts(shell, group))
                dgfem_shelli_scatter(system, group, factor, system->dense + (size_t)i * DGFEM_SHELLI_DENSE);
        }
    }
}

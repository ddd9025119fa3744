#pragma once
#include "element.c"
/* Precomputed terms of edges: the discontinuous Galerkin terms that keep the angle between two elements, or between an
   element and its support.

                  K-                       The directed edge e1 runs counter-clockwise through K+, which lies on its
             ^ e2 = nu-... points          left; te is the mean normal of both, e2 = te x e1 / |e1| points out of K-
             |     from K- into K+         into K+. The jump is (K+) - (K-). On the boundary the element is K-: e1
         ----+-----> e1 ----               runs against it and e2 points outward.
                  K+  (e2 drawn up)        All quantities of both sides are taken in the edge's frame: then rigid
                                           rotations give no jump, on folds too. */

typedef struct dgfem_shelli_edge_frame {
    dgfem_vec3 e1, e2, t;
    dgfem_real length; /* |e1| */
} dgfem_shelli_edge_frame;

/* Derivatives of one side's shape functions along the edge frame: N_,a = sum_b N_,b (phi^b . e_a), and p: the row that
   turns its bending strains 11, 22, 2*12 into the edge's moment m^22 = D (rho_22 + nu rho_11 / |e1|^2), without D. */
static void dgfem_shelli_to_edge(const dgfem_shelli_basis *f, const dgfem_shelli_frame *own,
                                 const dgfem_shelli_edge_frame *edge, int n, dgfem_real nu, dgfem_real *n1,
                                 dgfem_real *n2, dgfem_real *p) {
    dgfem_real t11 = dgfem_shelli_dot(own->c1, edge->e1), t12 = dgfem_shelli_dot(own->c1, edge->e2);
    dgfem_real t21 = dgfem_shelli_dot(own->c2, edge->e1), t22 = dgfem_shelli_dot(own->c2, edge->e2);
    dgfem_real along = nu / (edge->length * edge->length);
    for (int a = 0; a < n; a++) {
        n1[a] = f->d1[a] * t11 + f->d2[a] * t21;
        n2[a] = f->d1[a] * t12 + f->d2[a] * t22;
    }
    p[0] = along * t11 * t11 + t12 * t12;
    p[1] = along * t21 * t21 + t22 * t22;
    p[2] = along * t11 * t21 + t12 * t22;
}

/* g_a = Dt_a^T e2, the tilt of the normal towards e2 that a node's displacement causes, with
     Dt_a = ([e1]x - te (te x e1)^T) N_,2 / |e1| - ([e2]x - te (te x e2)^T) N_,1 / |e1|:
   te . e2 = 0 and [e2]x^T e2 = 0 leave e2 x e1 N_,2 / |e1|. */
static dgfem_vec3 dgfem_shelli_tilt(const dgfem_shelli_edge_frame *edge, dgfem_real n2) {
    return dgfem_shelli_scale(-n2, edge->t);
}

/* Adds one side of an edge point: jump and moment rows, and the gradients for the rotation. */
static void dgfem_shelli_add_side(const dgfem_shell *shell, dgfem_shell_system *system, const dgfem_shelli_group *group,
                                  const dgfem_shelli_point *point, int side, const dgfem_shelli_frame *own,
                                  const dgfem_shelli_edge_frame *edge) {
    const dgfem_shell_element *element = &shell->elements[group->element[side]];
    const dgfem_shelli_basis *f = &system->basis[point->basis[side]];
    int n = element->node_count, width = 3 * group->node_count;
    dgfem_real n1[DGFEM_SHELL_MAX_NODES], n2[DGFEM_SHELL_MAX_NODES], p[3], bending[9 * DGFEM_SHELL_MAX_NODES];
    dgfem_real *s = system->strains + point->strain_start;
    dgfem_vec3 *gradient = system->gradients + point->gradient_start;
    dgfem_real mean = group->sides == 2 ? DGFEM_R(0.5) : DGFEM_R(1);
    dgfem_real sign = group->sides == 2 && side == 0 ? DGFEM_R(1) : DGFEM_R(-1);
    dgfem_shelli_to_edge(f, own, edge, n, element->material.poisson, n1, n2, p);
    dgfem_shelli_bending_rows(f, own, n, bending);
    dgfem_real stiffness = mean * dgfem_shelli_bending_stiffness(element);
    for (int a = 0; a < n; a++) {
        int at = group->local[side][a];
        dgfem_vec3 tilt = dgfem_shelli_tilt(edge, n2[a]);
        s[3 * at] += sign * tilt.x, s[3 * at + 1] += sign * tilt.y, s[3 * at + 2] += sign * tilt.z;
        for (int i = 0; i < 3; i++)
            s[width + 3 * at + i] += stiffness * (p[0] * bending[3 * a + i] + p[1] * bending[3 * (n + a) + i] +
                                                  p[2] * bending[3 * (2 * n + a) + i]);
        dgfem_vec3 d = dgfem_shelli_scale(mean * n1[a] / (edge->length * edge->length), edge->e1);
        gradient[at] = dgfem_shelli_add(gradient[at], dgfem_shelli_axpy(d, mean * n2[a], edge->e2));
    }
}

/* Length per parameter and direction of the first side, as element[0] runs. */
static dgfem_vec3 dgfem_shelli_side_tangent(const dgfem_shelli_frame *own, int nodes, int side) {
    dgfem_shelli_parameter p = dgfem_shelli_corner(nodes, side),
                           q = dgfem_shelli_corner(nodes, (side + 1) % (nodes / 2));
    return dgfem_shelli_axpy(dgfem_shelli_scale((q.a - p.a) / 2, own->e1), (q.b - p.b) / 2, own->e2);
}

/* eta D / h of an edge: h the smaller area / perimeter, D the mean, eta the larger. */
static dgfem_real dgfem_shelli_penalty(const dgfem_shell *shell, const dgfem_shelli_group *group) {
    dgfem_real eta = 0, stiffness = 0, h = 0;
    for (int side = 0; side < group->sides; side++) {
        const dgfem_shell_element *element = &shell->elements[group->element[side]];
        dgfem_real own = element->area / element->perimeter;
        eta = dgfem_shelli_max(eta, dgfem_shelli_is_quad(element) ? shell->desc.eta_quad : shell->desc.eta_triangle);
        stiffness += dgfem_shelli_bending_stiffness(element) / (dgfem_real)group->sides;
        if (side == 0 || own < h) h = own;
    }
    return eta * stiffness / h;
}

static int dgfem_shelli_side_basis(const dgfem_shell_element *element, int side) {
    return (dgfem_shelli_is_quad(element) ? DGFEM_SHELLI_BASIS_QUAD_SIDES : DGFEM_SHELLI_BASIS_TRIANGLE_SIDES) +
           DGFEM_SHELLI_EDGE_POINTS * side;
}

/* Fills in the points of one edge, glued or boundary. Memory of S and D is zero. */
static dgfem_status dgfem_shelli_build_edge(const dgfem_shell *shell, dgfem_shell_system *system,
                                            const dgfem_shelli_group *group) {
    const dgfem_shell_edge *edge = &shell->edges[group->owner];
    dgfem_real penalty = dgfem_shelli_penalty(shell, group);
    for (int q = 0; q < group->point_count; q++) {
        dgfem_shelli_point *point = &system->points[group->point_start + q];
        dgfem_shelli_frame own[2];
        dgfem_shelli_edge_frame frame;
        for (int side = 0; side < group->sides; side++) {
            const dgfem_shell_element *element = &shell->elements[group->element[side]];
            dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
            int reversed = side == 0 ? q : DGFEM_SHELLI_EDGE_POINTS - 1 - q;
            dgfem_shelli_gather(shell->rest, element->node, element->node_count, x);
            point->basis[side] = dgfem_shelli_side_basis(element, edge->side[side]) + reversed;
            if (!dgfem_shelli_frame_at(&system->basis[point->basis[side]], x, element->node_count, &own[side]))
                return dgfem_shelli_fail_degenerate(shell, group->element[side]);
        }
        frame.e1 = dgfem_shelli_side_tangent(&own[0], shell->elements[group->element[0]].node_count, edge->side[0]);
        frame.t = own[0].t;
        if (group->sides == 2) frame.t = dgfem_shelli_unit(dgfem_shelli_add(own[0].t, own[1].t));
        else frame.e1 = dgfem_shelli_scale(-1, frame.e1);
        frame.e2 = dgfem_shelli_unit(dgfem_shelli_cross(frame.t, frame.e1));
        frame.length = dgfem_shelli_norm(frame.e1);
        if (!(frame.length > 0) || !(dgfem_shelli_dot(frame.e2, frame.e2) > DGFEM_R(0.5)))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "edge of nodes %d and %d: folded flat",
                                     edge->node[0], edge->node[1]);
        point->weight = dgfem_shelli_gauss_weight(q) * frame.length;
        point->t = frame.t;
        point->f1 = dgfem_shelli_scale(1 / frame.length, frame.e1);
        point->f2 = frame.e2;
        point->c[0] = point->weight * penalty;
        point->c[1] = point->weight;
        for (int side = 0; side < group->sides; side++)
            dgfem_shelli_add_side(shell, system, group, point, side, &own[side], &frame);
    }
    return DGFEM_OK;
}

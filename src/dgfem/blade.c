#pragma once
#include "planar.c"
/* A blade: a plane, or the part of a plane inside a simple polygon. Predicates that all cuts share, so that elements
   and render meshes agree on what lies on which side.

   The polygon is seen in the projection along the largest component of the blade's normal. Its boundary belongs to it
   on one side and not on the other (the rule of dgfemi_edge_winding), so that polygons that share an edge cover each
   point once. */

typedef struct dgfemi_blade {
    dgfem_vec3 normal; /* unit */
    dgfem_real offset;
    const dgfem_vec3 *polygon; /* in the plane, in either sense; NULL: the whole plane */
    int polygon_count;
} dgfemi_blade;

static dgfem_real dgfemi_blade_distance(const dgfemi_blade *blade, dgfem_vec3 x) {
    return dgfemi_dot(blade->normal, x) - blade->offset;
}

/* 1 where the normal points to, the plane included; 0 below. */
static int dgfemi_blade_side(const dgfemi_blade *blade, dgfem_vec3 x) { return dgfemi_blade_distance(blade, x) >= 0; }

static void dgfemi_blade_project(const dgfemi_blade *blade, dgfem_vec3 x, double *out) {
    int u, v;
    dgfemi_projection_axes(blade->normal, &u, &v);
    out[0] = (double)dgfemi_axis(x, u), out[1] = (double)dgfemi_axis(x, v);
}

/* Whether the foot of a point on the plane lies in the polygon. */
static int dgfemi_blade_covers(const dgfemi_blade *blade, dgfem_vec3 x) {
    double a[2], b[2], q[2];
    int winding = 0;
    if (!blade->polygon) return 1;
    dgfemi_blade_project(blade, dgfemi_add_scaled(x, -dgfemi_blade_distance(blade, x), blade->normal), q);
    dgfemi_blade_project(blade, blade->polygon[blade->polygon_count - 1], b);
    for (int i = 0; i < blade->polygon_count; i++) {
        memcpy(a, b, sizeof a);
        dgfemi_blade_project(blade, blade->polygon[i], b);
        winding += dgfemi_edge_winding(a, b, q);
    }
    return winding != 0;
}

/* A box around the polygon; around everything without one. */
static void dgfemi_blade_box(const dgfemi_blade *blade, dgfem_vec3 *lower, dgfem_vec3 *upper) {
    dgfem_real all = (dgfem_real)HUGE_VAL;
    *lower = dgfemi_vec3(-all, -all, -all), *upper = dgfemi_vec3(all, all, all);
    if (!blade->polygon) return;
    *lower = *upper = blade->polygon[0];
    for (int i = 1; i < blade->polygon_count; i++) {
        *lower = dgfemi_min3(*lower, blade->polygon[i]);
        *upper = dgfemi_max3(*upper, blade->polygon[i]);
    }
}

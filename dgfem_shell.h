/* dgfem_shell.h - thin shells by discontinuous Galerkin finite elements

   A single-header library in C99 (also C++), sister of dgfem.h. It moves sheets, cans and skins made of plain triangles
   and quadrilaterals: a Kirchhoff-Love shell with displacements as its only unknowns, large rotations, contact, cuts.
   The accuracy is that of engineering codes, the use that of a cloth solver. It needs dgfem.h, libc and libm.

   The method is that of L. Noels and R. Radovitzky, "A new discontinuous Galerkin method for Kirchhoff-Love shells"
   (2008), as implemented by P. Kaufmann, S. Martin, M. Botsch, M. Gross, "Implementation of Discontinuous Galerkin
   Kirchhoff-Love Shells" (2009), with corrections. Equation numbers in comments refer to that report.


   HOW TO BUILD IT IN

   In exactly one C or C++ file:

       #define DGFEM_IMPLEMENTATION
       #include "dgfem_shell.h"

   and everywhere else only #include "dgfem_shell.h". It includes dgfem.h, which the same macro implements in the same
   file. Configuration macros, hooks, descriptors, units and statuses are those of dgfem.h: see there.


   HOW IT IS USED

       dgfem_shell_create           vertices and polygons              -> a shell; middle nodes are made, on a curved
                                                                          surface by callback, or given
       dgfem_shell_fix_nodes, _clamp, _fix_symmetry, _fix_rotation     what holds it
       dgfem_shell_set_moment, _set_line_load, _set_pressure, _add_force, _pin, _set_gravity   what loads it
       dgfem_shell_solve_static     equilibrium, by Newton's method in load steps
       dgfem_shell_step             motion, by implicit Euler; with contact: _add_plane, _add_sphere, _move_shape
       dgfem_shell_cut_edges, _cut_plane                               cuts, hinges
       dgfem_shell_surface_create, _update                             triangles to draw, both sides

   The hook parallel_for serves the stiffness and the forces of elements and edges, and the factorization; contact,
   loads and cuts run on the caller's thread. Results are the same bits for any number of threads.

   Elements have 8 nodes (quadrilaterals) or 6 (triangles); a mesh may have both. Edges may be shared by two elements at
   most, and neighbours must be oriented alike. Nothing is said about rotations at nodes, for there are none: that the
   angle between two elements is kept, or that a clamped side keeps its slope, is said by terms on their edges. So a
   simple support is just nodes held, a hinge is an edge without its terms, and a free edge is nothing at all.


   A WHOLE PROGRAM

       #define DGFEM_IMPLEMENTATION
       #include "dgfem_shell.h"
       #include <stdio.h>

       int main(void) {
           // A sheet of 1 m x 0.5 m: eight squares.
           double vertices[45];
           int quads[32];
           for (int j = 0; j < 3; j++)
               for (int i = 0; i < 5; i++)
                   vertices[3 * (i + 5 * j)] = 0.25 * i, vertices[3 * (i + 5 * j) + 1] = 0.25 * j,
                                        vertices[3 * (i + 5 * j) + 2] = 0;
           for (int k = 0; k < 8; k++) {
               int corner = k % 4 + 5 * (k / 4);
               quads[4 * k] = corner, quads[4 * k + 1] = corner + 1;
               quads[4 * k + 2] = corner + 6, quads[4 * k + 3] = corner + 5;
           }

           // 1. A shell of 2 mm of rubber; gravity is (0, 0, -9.81) m/s^2.
           dgfem_shell_desc desc = dgfem_default_shell_desc();
           desc.vertices = dgfem_points_in_double(vertices, 15);
           desc.quads = quads;
           desc.quad_count = 8;
           desc.thickness = DGFEM_R(0.002);
           desc.material.young = DGFEM_R(1e7);
           desc.damping_mass = 1;
           dgfem_shell *shell;
           dgfem_status status = dgfem_shell_create(&desc, &shell);
           if (status) return puts(dgfem_status_text(status)), 1;

           // 2. Clamp the side x = 0.
           dgfem_plane wall = {{1, 0, 0}, 0};
           int edges[2];
           int count = dgfem_shell_edges_on_plane(shell, wall, DGFEM_R(1e-6), edges, 2);
           if (dgfem_shell_clamp(shell, edges, count, NULL)) return 1;

           // 3. One second of swinging; then it is cut off at x = 0.6 m.
           int tip = dgfem_shell_nearest_node(shell, shell->rest[4]);
           for (int step = 1; step <= 60; step++)
               if (dgfem_shell_step(shell, DGFEM_R(1) / 60, NULL)) return 1;
           printf("the corner hangs %.1f m lower\n", -(double)shell->position[tip].z);
           dgfem_shell_cut_desc cut = dgfem_default_shell_cut_desc();
           cut.current = 0; // the plane is meant at rest
           cut.plane.offset = DGFEM_R(0.6);
           dgfem_shell_cut_info info;
           if (dgfem_shell_cut_plane(shell, &cut, &info)) return 1;
           printf("%d pieces\n", info.pieces);

           // 4. Triangles to draw: update them after each step, make them anew after each cut.
           dgfem_shell_surface_desc surface_desc = dgfem_default_shell_surface_desc();
           dgfem_shell_surface *surface;
           if (dgfem_shell_surface_create(shell, &surface_desc, &surface)) return 1;
           if (dgfem_shell_step(shell, DGFEM_R(1) / 60, NULL)) return 1;
           if (dgfem_shell_surface_update(surface, shell)) return 1;
           printf("%d triangles\n", surface->triangle_count);
           dgfem_shell_surface_destroy(surface);
           dgfem_shell_destroy(shell);
           return 0;
       }


   WHAT IT DOES NOT DO

   - Materials other than isotropic linear ones. Strains are small, rotations as large as you like: each quadrature
     point follows its own.
   - Transverse shear. For shells thicker than about a tenth of their span use solids.
   - Contact of a shell with itself or another. It touches shapes at its nodes: a corner of a shape may pass between.
   - Shells of three and more sheets at one edge.


   NUMERIC LIMITS

   - The penalty factor eta. Quadrilaterals: 2 (default) is accurate, 10 conservative, 1 overshoots on coarse meshes;
     triangles: 1. Larger ones lock, triangles first. Below 0.6 the stiffness may be indefinite.
   - Quadrilaterals of 8 nodes represent constant curvature where they are parallelograms; very distorted ones stall at
     an error of some tenths of a per cent. Triangles of 6 nodes bend stiffly on coarse curved meshes.
   - Thin shells need double: membrane and bending stiffness differ by (length / thickness)^2. In float, forces at large
     rotations are good to about 1e-7 (length / thickness)^2 of the bending ones; 100 : 1 is beyond it. So are many
     elements in a row, for their bending stiffnesses differ by (length / element)^4: a cantilever of eight ends within
     1 % of where it should, one of sixteen is off by 15 %.
   - dgfem_shell_solve_static converges for loads and clamps that turn the shell by some 60 degrees in one part; take
     load steps. Past limit points it cannot go under load: prescribe displacements or take time steps.
   - A step is as stable as implicit Euler for any dt, but it stops iterating after step_iterations: watch the residual.
     In unstable states (a buckling shell) with dt too long to resolve them it converges slowly; where it gets nowhere,
     one semi-implicit step with frozen rotations is taken instead. Implicit Euler damps: a motion of angular frequency
     w loses about dt w^2 / 2 of its amplitude per unit of time.
   - Cuts make small triangles. Those cost accuracy and condition, not stability; `snap` keeps the smallest away.
   - A linear shell (corotational 0) is solved by one factorization, however thin, in double.


   LICENCE

   MIT; the text stands at the end of this file. */

/* Contents, in the order of dependency; search for "== name".

   api.h              Public types and declarations of shells.
   base.c             Log, memory and small vectors of the shells' own.
   shape.c            Shape functions, quadrature points and sides of the two elements.
   mesh.c             From vertices and polygons to elements with middle nodes and edges.
   element.c          Precomputed terms of the elements' quadrature points: membrane and bending strain as matrices,
                      stiffness, frames.
   edge.c             Precomputed terms of edges: the discontinuous Galerkin terms that keep the angle between two
                      elements, or between an element and its support.
   corotation.c       Forces and tangents at large rotations: every quadrature point sees the shell through its own
                      rotation.
   system.c           The groups of all elements and edges, the block matrix of the nodes, and the shell's creation.
   conditions.c       What holds and loads a shell: the list of conditions and contact shapes.
   load.c             External forces, their derivatives, and the directions in which nodes are held.
   static.c           Static equilibrium by Newton's method or frozen rotations, in load steps.
   step.c             Implicit Euler: one step solves, for the velocities v at its end, (1 + h alpha) M v + h (f_int(x
                      + h v) + f_damp - F_ext - F_contact) = M v0, x+ = x + h v, by Newton's method.
   query.c            What can be asked about a shell's state.
   cut.c              Topology that changes: edges separated or turned into hinges, elements split along a plane.
   split.c            Cuts across elements: triangles that follow a plane take the place of the elements that it
                      crosses.
   surface.c          Render surface: the curved elements evaluated on a lattice of parameters, with their exact
                      normals, as one or two sheets of triangles, closed by rims along the boundary. */

#include "dgfem.h"

#ifndef DGFEM_SHELL_H
#define DGFEM_SHELL_H

/* ==== api.h ======================================================================================================= */

/* Public types and declarations of shells. */

/* Objects made with one precision must not reach code compiled for the other; see dgfem.h. */
#if DGFEM_REAL_IS_FLOAT
#define dgfem_shell_create dgfem_shell_create_float
#define dgfem_shell_surface_create dgfem_shell_surface_create_float
#endif

/* ---- mesh ---------------------------------------------------------------------------------------------------- */

#define DGFEM_SHELL_MAX_NODES 8

/* A curved quadrilateral (8 nodes) or triangle (6 nodes). Corners come first, counter-clockwise seen from the side that
   the normal points to, then the middle of each side:

       3 ---- 6 ---- 2          2
       |             |          | \               parameters (a, b): the quadrilateral is -1 <= a, b <= 1,
       7      q      5          5   4             the triangle 0 <= a, b, a + b <= 1;
       |             |          |     \           corner 0 is lower left, a runs to the right, b upward
       0 ---- 4 ---- 1          0 - 3 - 1

   Side k runs from corner k to corner k + 1; its middle is node corners + k. */
typedef struct dgfem_shell_element {
    int node_count; /* 8 or 6; corners: half of it */
    int node[DGFEM_SHELL_MAX_NODES];
    int edge[4]; /* of each side */
    int tag;     /* index of the input element that it came from; pieces of a cut inherit it */
    dgfem_real thickness;
    dgfem_material material;
    dgfem_real area, perimeter; /* at rest */
} dgfem_shell_element;

/* How two elements meet. */
typedef enum dgfem_shell_joint {
    DGFEM_SHELL_GLUED, /* the angle between them is kept by the discontinuous Galerkin terms */
    DGFEM_SHELL_HINGE, /* they share nodes only, and turn freely */
    DGFEM_SHELL_GAP    /* separated; as an argument of the cutting functions only: such edges become boundary */
} dgfem_shell_joint;

typedef struct dgfem_shell_edge {
    int node[3];    /* start, end, middle, as element[0] runs through it: it lies on the left */
    int element[2]; /* element[1] is DGFEM_NONE on the boundary */
    int side[2];    /* of each element */
    dgfem_shell_joint joint;
    int loop;                           /* of the boundary, as dgfem_shell_boundary counts them; inside DGFEM_NONE */
    int support;                        /* index of the condition that holds its rotation, or DGFEM_NONE */
    dgfem_real moment, follower_moment; /* sum of the conditions' moments per length, N */
} dgfem_shell_edge;

/* Where on the curved surface a middle node belongs, given the midpoint of its two corners a and b. */
typedef dgfem_vec3 (*dgfem_shell_surface_fn)(void *user, dgfem_vec3 midpoint, dgfem_vec3 a, dgfem_vec3 b);

typedef struct dgfem_shell_desc {
    unsigned cookie;
    dgfem_points_in vertices; /* corners, and middle nodes where they are given; each must be used */
    const int *quads;         /* nodes_per_quad vertex indices each; elements 0 .. quad_count - 1 */
    int quad_count;
    const int *triangles; /* nodes_per_triangle vertex indices each; the elements that follow */
    int triangle_count;
    int nodes_per_quad;             /* 4 (default): middle nodes are made; 8: they are given */
    int nodes_per_triangle;         /* 3 (default) or 6, likewise. Both kinds must agree where both are present. */
    dgfem_shell_surface_fn surface; /* NULL (default): middle nodes are made at the midpoints */
    void *surface_user;
    dgfem_real thickness;            /* default 0.001 m */
    const dgfem_real *thicknesses;   /* [elements] or NULL: `thickness` everywhere */
    dgfem_material material;         /* default 1e9 Pa, 0.3, 1000 kg/m^3 */
    const dgfem_material *materials; /* [elements] or NULL: `material` everywhere */
    dgfem_real eta_quad;             /* penalty factor of edges between quadrilaterals; default 2, conservative 10 */
    dgfem_real eta_triangle;         /* the same for triangles; default 1. Where both meet, the larger counts. */
    dgfem_vec3 gravity;              /* default 0 0 -9.81 m/s^2 */
    dgfem_real damping_mass;         /* Rayleigh alpha, 1/s; default 0 */
    dgfem_real damping_stiffness;    /* Rayleigh beta, s; default 0. Nothing that moves rigidly is damped by it. */
    int corotational;                /* 1 (default): large rotations; 0: linear shell */
    int consistent_mass;       /* 0 (default): lumped, in proportion to the integral of N^2 (HRZ); 1: consistent */
    int step_iterations;       /* Newton iterations of a time step at most; default 4 */
    dgfem_real step_tolerance; /* and where they end: residual relative to forces; default 1e-4 */
    dgfem_hooks hooks;
} dgfem_shell_desc;

/* ---- conditions ---------------------------------------------------------------------------------------------- */

/* Axes of dgfem_shell_fix_nodes, to be added up. */
#define DGFEM_SHELL_X 1
#define DGFEM_SHELL_Y 2
#define DGFEM_SHELL_Z 4
#define DGFEM_SHELL_XYZ 7

/* What holds or loads a shell. Each condition has an id, under which it is moved or removed. */
typedef enum dgfem_shell_condition_kind {
    DGFEM_SHELL_CONDITION_FIX,       /* nodes: displacement given along some of the axes */
    DGFEM_SHELL_CONDITION_SYMMETRY,  /* boundary edges in a plane: no displacement across it, no turn about the edge */
    DGFEM_SHELL_CONDITION_CLAMP,     /* boundary edges: nodes and normals follow a rigid motion */
    DGFEM_SHELL_CONDITION_ROTATION,  /* boundary edges: the rotation about the edge is given */
    DGFEM_SHELL_CONDITION_MOMENT,    /* moment per length about boundary edges */
    DGFEM_SHELL_CONDITION_LINE_LOAD, /* force per length along edges */
    DGFEM_SHELL_CONDITION_PRESSURE,  /* force per area along the normal of elements */
    DGFEM_SHELL_CONDITION_FORCE,     /* force on each of some nodes */
    DGFEM_SHELL_CONDITION_PIN        /* a spring from a node to a place */
} dgfem_shell_condition_kind;

typedef struct dgfem_shell_condition {
    int id;
    dgfem_shell_condition_kind kind;
    int count;                /* of items */
    int *items;               /* nodes, edges or elements, as the kind says */
    int axes;                 /* FIX */
    int follower;             /* MOMENT, PRESSURE: 1 when the load turns with the shell */
    dgfem_vec3 vector;        /* displacement, normal of the plane, translation, line load, force, place of a pin */
    dgfem_real scalar;        /* angle, moment, pressure, stiffness */
    dgfem_mat3 rotation;      /* CLAMP */
    dgfem_vec3 vector_before; /* what the last static solve or step ended with: where the next static solve begins */
    dgfem_real scalar_before;
    dgfem_mat3 rotation_before;
} dgfem_shell_condition;

/* ---- shell --------------------------------------------------------------------------------------------------- */

typedef struct dgfem_shell_system dgfem_shell_system; /* precomputed integrals and the solver, opaque */

/* State of a shell. Read freely; change only through functions. */
typedef struct dgfem_shell {
    dgfem_shell_desc desc;
    int revision; /* grows with every change of topology */
    int node_count, element_count, edge_count;
    dgfem_vec3 *rest;        /* [node_count] */
    dgfem_vec3 *position;    /* [node_count] */
    dgfem_vec3 *velocity;    /* [node_count] */
    dgfem_real *node_area;   /* [node_count] what each node has of the area; sums to it */
    dgfem_real *node_mass;   /* [node_count] lumped */
    dgfem_real *node_load;   /* [node_count] integral of density * thickness * N: times gravity its weight */
    dgfem_real *node_half;   /* [node_count] half the thickness: the largest of the node's elements */
    dgfem_real *node_spring; /* [node_count] E * thickness, for contact (N/m) */
    dgfem_shell_element *elements;
    dgfem_shell_edge *edges;
    int condition_count, condition_capacity, next_id;
    dgfem_shell_condition *conditions;
    int shape_count, shape_capacity;
    dgfem_shape *shapes;
    dgfem_vec3 gravity_before; /* as vector_before of a condition */
    double time;               /* sum of the steps */
    dgfem_shell_system *system;
    dgfem_hooks hooks;
} dgfem_shell;

typedef struct dgfem_shell_info {
    int iterations;      /* Newton iterations, of all load steps */
    int load_steps;      /* static solve: taken, halved ones included */
    int shifts;          /* factorizations repeated because the tangent was not positive definite */
    int contacts;        /* nodes that touched a shape */
    int failed_node;     /* whose pivot was not positive, or DGFEM_NONE */
    dgfem_real residual; /* of the last iterate, relative to the forces */
    double seconds_assemble, seconds_factor, seconds_solve; /* 0 without a clock */
} dgfem_shell_info;

typedef struct dgfem_shell_static_desc {
    unsigned cookie;
    int load_steps;        /* loads, motions and turns of supports are applied in this many equal parts; default 1 */
    int max_halvings;      /* how often a part that fails may be halved; default 6 */
    int max_iterations;    /* of Newton per part; default 40 */
    dgfem_real tolerance;  /* residual relative to the forces; default 1e-8 (float: 1e-3) */
    int line_search;       /* 0: none; 1 (default): in parts that had to be halved; 2: always, which is slow */
    int frozen;            /* 0 (default): Newton with the consistent tangent; 1: fixed point with frozen rotations */
    dgfem_real relaxation; /* of the fixed point: part of each update that is taken; default 0.5 */
} dgfem_shell_static_desc;

DGFEM_API dgfem_shell_desc dgfem_default_shell_desc(void);
DGFEM_API dgfem_shell_static_desc dgfem_default_shell_static_desc(void);

/* Nodes 0 .. vertices.count - 1 are the vertices, in their order; made middle nodes follow. Refuses edges of more than
   two elements, given middle nodes that are corners elsewhere or that differ between the same two corners
   (DGFEM_ERROR_NOT_CONFORMING), neighbours of opposite orientation (DGFEM_ERROR_INSIDE_OUT), unused vertices,
   degenerate elements; the log names element and edge. */
DGFEM_API dgfem_status dgfem_shell_create(const dgfem_shell_desc *desc, dgfem_shell **out);
DGFEM_API void dgfem_shell_destroy(dgfem_shell *shell);

/* The loops of the boundary: writes the edges, each loop in order and without a gap, and where each loop starts
   (loop_start[loops] is the number of edges). Returns the number of loops. Either array may be NULL; room for
   edge_count edges and edge_count + 1 starts always suffices. */
DGFEM_API int dgfem_shell_boundary(const dgfem_shell *shell, int *edges, int *loop_start);

/* What lies within `tolerance` of a plane (unit normal) at rest: of the edges those on the boundary, all three of whose
   nodes do; of the nodes all, inside the shell too. Writes at most `capacity` indices (none where the array is NULL);
   returns the number there are. */
DGFEM_API int dgfem_shell_edges_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *edges,
                                         int capacity);
DGFEM_API int dgfem_shell_nodes_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                         int capacity);

/* The node whose current position is the nearest to x. */
DGFEM_API int dgfem_shell_nearest_node(const dgfem_shell *shell, dgfem_vec3 x);

/* ---- conditions ----

   Each of these functions adds a condition, those called set_... too, as in dgfem.h: what several say about the same
   nodes, edges or elements is added up, except that an edge's rotation is held by one at most and nodes by whichever
   came first. *id (may be NULL) names the new one; under it the condition is moved, changed or removed. What is moved
   or changed takes effect with the next step, at once, or along the path of the next static solve. */

/* Gives the displacement of nodes from rest along the axes (DGFEM_SHELL_X + ...), exactly. Nothing else makes a simple
   support, or (with the axes of its plane) a rigid diaphragm. */
DGFEM_API dgfem_status dgfem_shell_fix_nodes(dgfem_shell *shell, const int *nodes, int count, int axes,
                                             dgfem_vec3 displacement, int *id);
/* Boundary edges in a plane of symmetry with this normal. */
DGFEM_API dgfem_status dgfem_shell_fix_symmetry(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 normal,
                                                int *id);
/* Clamps boundary edges: nodes are held exactly, normals weakly, in a rigid motion x = rotation X + translation that is
   the identity until dgfem_shell_move_clamp changes it. A static solve takes it from the one placement to the other by
   a screw motion, the shorter way round: more than half a turn needs several solves. */
DGFEM_API dgfem_status dgfem_shell_clamp(dgfem_shell *shell, const int *edges, int count, int *id);
/* Gives, weakly, the rotation of the normal about boundary edges; counter-clockwise about the edge as the element runs
   through it, which tilts the normal outward. Nodes stay free. Without large rotations of the edge itself. */
DGFEM_API dgfem_status dgfem_shell_fix_rotation(dgfem_shell *shell, const int *edges, int count, dgfem_real angle,
                                                int *id);
/* Move fixed nodes, clamps and given rotations. */
DGFEM_API dgfem_status dgfem_shell_move_fixture(dgfem_shell *shell, int id, dgfem_vec3 displacement);
DGFEM_API dgfem_status dgfem_shell_move_clamp(dgfem_shell *shell, int id, dgfem_mat3 rotation, dgfem_vec3 translation);
DGFEM_API dgfem_status dgfem_shell_turn_edges(dgfem_shell *shell, int id, dgfem_real angle);

/* Moment per length (N) on boundary edges; positive tilts the normal outward (it bends a flat plate downward at that
   edge, seen with the normal up: rho_nn > 0). A follower turns with the shell. */
DGFEM_API dgfem_status dgfem_shell_set_moment(dgfem_shell *shell, const int *edges, int count, dgfem_real moment,
                                              int follower, int *id);
/* Force per rest length (N/m) on any edges. */
DGFEM_API dgfem_status dgfem_shell_set_line_load(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 load,
                                                 int *id);
/* Pressure (N/m^2) along the normal: of the rest state, or of the current one, area included, for a follower. elements
   may be NULL: all. Without corotational nothing turns: followers, pressures and moments alike, act as dead loads. */
DGFEM_API dgfem_status dgfem_shell_set_pressure(dgfem_shell *shell, const int *elements, int count, dgfem_real pressure,
                                                int follower, int *id);
/* Force (N) on each of the nodes; on one that is listed twice, twice. */
DGFEM_API dgfem_status dgfem_shell_add_force(dgfem_shell *shell, const int *nodes, int count, dgfem_vec3 force,
                                             int *id);
/* A spring (N/m) that pulls a node to where it is now; drag moves the place. */
DGFEM_API dgfem_status dgfem_shell_pin(dgfem_shell *shell, int node, dgfem_real stiffness, int *id);
DGFEM_API dgfem_status dgfem_shell_drag(dgfem_shell *shell, int id, dgfem_vec3 place);
/* Changes the scalar (moment, pressure) or the vector (line load, force) of a load. */
DGFEM_API dgfem_status dgfem_shell_change_load(dgfem_shell *shell, int id, dgfem_vec3 vector, dgfem_real scalar);
DGFEM_API dgfem_status dgfem_shell_set_gravity(dgfem_shell *shell, dgfem_vec3 gravity);
DGFEM_API dgfem_status dgfem_shell_remove_condition(dgfem_shell *shell, int id);

/* Contact shapes; *id (may be NULL) names the new one, to be moved or removed. Every node keeps half the shell's
   thickness from the shape, whichever side it turns to it. */
DGFEM_API dgfem_status dgfem_shell_add_plane(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_shell_add_sphere(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_shell_move_shape(dgfem_shell *shell, int id, const dgfem_shape_desc *desc);
DGFEM_API dgfem_status dgfem_shell_remove_shape(dgfem_shell *shell, int id);

/* ---- motion ---- */

/* One step of implicit Euler with Newton iterations on the consistent tangent; where that is not positive definite,
   with mass added. It ends after step_iterations at the latest and takes what it has, or where that is nothing, one
   semi-implicit step: info (may be NULL) tells the residual. Nothing is allocated. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_shell_step(dgfem_shell *shell, dgfem_real dt, dgfem_shell_info *info);

/* Static equilibrium, from the current state, of loads, fixtures and pins (contact takes no part). Velocities become
   zero. DGFEM_ERROR_NOT_CONVERGED leaves the shell as it was; DGFEM_ERROR_UNCONSTRAINED: nothing holds it. */
DGFEM_API dgfem_status dgfem_shell_solve_static(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                                dgfem_shell_info *info);

/* Whether the tangent stiffness at the current state, with all fixtures, is positive definite: 1 for a stable
   equilibrium, 0 beyond a limit or bifurcation point. */
DGFEM_API dgfem_status dgfem_shell_is_stable(dgfem_shell *shell, int *stable);

/* ---- state ---- */

/* Puts all nodes; velocities are kept. Fixtures take effect with the next step or solve. */
DGFEM_API dgfem_status dgfem_shell_set_positions(dgfem_shell *shell, dgfem_points_in positions);
DGFEM_API dgfem_status dgfem_shell_set_velocities(dgfem_shell *shell, dgfem_points_in velocities);

/* A point of an element, at the parameters (a, b), in the current state. NULL for what is not wanted. */
DGFEM_API dgfem_status dgfem_shell_evaluate(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                            dgfem_vec3 *position, dgfem_vec3 *normal);

/* Strains of the middle surface at a point, in the orthonormal rest frame whose first axis is the tangent along a, and
   the stress resultants they cause: 11, 22, 12 (tensor components) of membrane strain and force per length (N/m), of
   bending strain (1/m, minus the change of curvature) and moment per length (N). */
typedef struct dgfem_shell_strain {
    dgfem_real membrane[3], bending[3];
    dgfem_real force[3], moment[3];
    dgfem_mat3 rotation; /* of the point, from rest */
    dgfem_mat3 frame;    /* columns: first and second axis, normal, at rest */
} dgfem_shell_strain;

DGFEM_API dgfem_status dgfem_shell_strain_at(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                             dgfem_shell_strain *out);

/* Internal elastic force on every node, supports of edges included (what static equilibrium balances), for the current
   positions: out[node_count]. */
DGFEM_API dgfem_status dgfem_shell_internal_force(const dgfem_shell *shell, dgfem_vec3 *out);

/* Derivative of the internal force in a direction, exactly (the consistent, not quite symmetric tangent):
   out[node_count]. */
DGFEM_API dgfem_status dgfem_shell_tangent_multiply(const dgfem_shell *shell, const dgfem_vec3 *direction,
                                                    dgfem_vec3 *out);

/* External force on every node: gravity, loads, pins. */
DGFEM_API dgfem_status dgfem_shell_external_force(const dgfem_shell *shell, dgfem_vec3 *out);

/* The stiffness of frozen rotations, or (tangent = 1) the symmetric part of the tangent, without fixtures, pins and
   loads: a matrix of node_count blocks of size 3, owned by the shell and good until its next call. */
DGFEM_API dgfem_status dgfem_shell_stiffness(dgfem_shell *shell, int tangent, const dgfem_matrix **out);

DGFEM_API dgfem_status dgfem_shell_energy(const dgfem_shell *shell, dgfem_energy *out);
DGFEM_API dgfem_status dgfem_shell_momentum(const dgfem_shell *shell, dgfem_vec3 *linear, dgfem_vec3 *angular);
DGFEM_API dgfem_real dgfem_shell_mass(const dgfem_shell *shell);
DGFEM_API dgfem_real dgfem_shell_area(const dgfem_shell *shell); /* at rest */

/* ---- cutting ---- */

/* Separates (DGFEM_SHELL_GAP) or unglues (DGFEM_SHELL_HINGE) interior edges, or glues hinges again (DGFEM_SHELL_GLUED).
   Nodes around which elements fall apart are doubled; fixtures hold all copies, forces, pins and line loads stay with
   one. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_shell_cut_edges(dgfem_shell *shell, const int *edges, int count, dgfem_shell_joint joint);

typedef struct dgfem_shell_cut_desc {
    unsigned cookie;
    dgfem_plane plane; /* of the cut */
    int current;       /* 0: plane and segment are meant at rest; 1 (default): in the current positions */
    int bounded;       /* 0 (default): all of the plane; 1: only elements whose part of the cut has its middle */
    dgfem_vec3 from,
        to;          /*   between the planes through these points, perpendicular to the line from one to the other */
    dgfem_real snap; /* a corner nearer to the plane than this part of a crossed side counts as on it; default 0.1 */
    dgfem_shell_joint joint; /* default gap; glued only refines along the plane */
} dgfem_shell_cut_desc;

typedef struct dgfem_shell_cut_info {
    int elements_split; /* elements that were replaced by triangles */
    int edges_cut;      /* edges along which the shell came apart */
    int nodes_added;
    int pieces; /* connected components afterwards */
} dgfem_shell_cut_info;

DGFEM_API dgfem_shell_cut_desc dgfem_default_shell_cut_desc(void);

/* Cuts across elements: those that the plane crosses are split into triangles along it; their neighbours are split as
   far as conformity asks. Middle nodes are interpolated in the parent: triangles keep their geometry and state exactly,
   quadrilaterals where they are flat parallelograms their geometry. The middle node of a side that is split becomes the
   corner at the crossing, and takes with it what fixes it; a force or a pin on it goes to the nearest node on its own
   side of the cut, the pin's place by as much. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_shell_cut_plane(dgfem_shell *shell, const dgfem_shell_cut_desc *desc,
                                             dgfem_shell_cut_info *info);

/* Number of connected components; piece[element_count] (may be NULL) receives each element's. */
DGFEM_API dgfem_status dgfem_shell_pieces(const dgfem_shell *shell, int *count, int *piece);

/* ---- render surface ---- */

typedef struct dgfem_shell_surface_desc {
    unsigned cookie;
    int subdivision;   /* each side of an element becomes this many; default 2 */
    int sides;         /* 2 (default): both faces, half the thickness apart from the middle, closed by rims; 1: the */
    dgfem_hooks hooks; /*   middle surface */
} dgfem_shell_surface_desc;

typedef struct dgfem_shell_surface {
    int vertex_count, triangle_count;
    dgfem_vec3 *positions; /* as of the last update */
    dgfem_vec3 *normals;   /* of the curved elements, exact; where elements meet, the mean of theirs */
    int *triangles;        /* counter-clockwise from outside */
    int *triangle_element; /* element of each triangle */
    int revision;          /* of the shell it was made for, and its size: */
    int element_count, node_count;
    int subdivision, sides;
    int point_count;  /* points of the middle surface */
    int *point_of;    /* for each element its points, row by row */
    int *point_start; /* [elements + 1] */
    dgfem_real *half; /* [points] half the thickness */
    dgfem_hooks hooks;
} dgfem_shell_surface;

DGFEM_API dgfem_shell_surface_desc dgfem_default_shell_surface_desc(void);
DGFEM_API dgfem_status dgfem_shell_surface_create(const dgfem_shell *shell, const dgfem_shell_surface_desc *desc,
                                                  dgfem_shell_surface **out);
DGFEM_API void dgfem_shell_surface_destroy(dgfem_shell_surface *surface);

/* Follows the shell; nothing is allocated. DGFEM_ERROR_REVISION when its topology has changed. */
DGFEM_API dgfem_status dgfem_shell_surface_update(dgfem_shell_surface *surface, const dgfem_shell *shell);

#endif /* DGFEM_SHELL_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_SHELL_IMPLEMENTED)
#define DGFEM_SHELL_IMPLEMENTED

/* ==== base.c ====================================================================================================== */

/* Log, memory and small vectors of the shells' own. */

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef DGFEM_ASSERT
#include <assert.h>
#define DGFEM_ASSERT(condition) assert(condition)
#endif

#if defined(__GNUC__) || defined(__clang__)
#define DGFEM_SHELL_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_SHELL_PRINTF(format_index, first)
#endif

#define DGFEM_SHELL_COOKIE 0x5e110001u

/* ---- log ---- */

/* Logs one line and returns the status. */
DGFEM_SHELL_PRINTF(3, 4)
static dgfem_status dgfem_shelli_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem_shell: %s: ", dgfem_status_text(status));
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfem_shelli_fail_memory(const dgfem_hooks *hooks) {
    return dgfem_shelli_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- memory ---- */

static void *dgfem_shelli_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (!count) count = 1; /* NULL always means failure */
    if (count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Zeroed. */
static void *dgfem_shelli_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfem_shelli_reallocate(hooks, NULL, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void *dgfem_shelli_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfem_shelli_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

static void dgfem_shelli_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

/* Temporary memory of one operation. Zeroed memory with `hooks` set is empty. */
typedef struct dgfem_shelli_scratch {
    const dgfem_hooks *hooks;
    void *blocks[32];
    int count;
} dgfem_shelli_scratch;

static dgfem_shelli_scratch dgfem_shelli_scratch_make(const dgfem_hooks *hooks) {
    dgfem_shelli_scratch scratch;
    memset(&scratch, 0, sizeof scratch);
    scratch.hooks = hooks;
    return scratch;
}

static void *dgfem_shelli_take(dgfem_shelli_scratch *scratch, size_t count, size_t size) {
    DGFEM_ASSERT(scratch->count < 32);
    void *pointer = dgfem_shelli_allocate(scratch->hooks, count, size);
    if (pointer) scratch->blocks[scratch->count++] = pointer;
    return pointer;
}

static void dgfem_shelli_scratch_free(dgfem_shelli_scratch *scratch) {
    while (scratch->count) dgfem_shelli_free(scratch->hooks, scratch->blocks[--scratch->count]);
}

static double dgfem_shelli_clock(const dgfem_hooks *hooks) {
    return hooks->clock ? hooks->clock(hooks->clock_user) : 0;
}

/* ---- scalars and vectors ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_SHELL_EPSILON 1.1920929e-7f
#else
#define DGFEM_SHELL_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfem_shelli_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfem_shelli_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfem_shelli_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfem_shelli_is_finite(dgfem_real x) { return x - x == 0; }

static dgfem_vec3 dgfem_shelli_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfem_shelli_add(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static dgfem_vec3 dgfem_shelli_sub(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static dgfem_vec3 dgfem_shelli_scale(dgfem_real s, dgfem_vec3 a) {
    return dgfem_shelli_vec3(s * a.x, s * a.y, s * a.z);
}
static dgfem_vec3 dgfem_shelli_axpy(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static dgfem_real dgfem_shelli_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfem_shelli_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_shelli_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfem_shelli_norm(dgfem_vec3 a) { return dgfem_shelli_sqrt(dgfem_shelli_dot(a, a)); }
/* The zero vector stays zero. */
static dgfem_vec3 dgfem_shelli_unit(dgfem_vec3 a) {
    dgfem_real length = dgfem_shelli_norm(a);
    return length > 0 ? dgfem_shelli_scale(1 / length, a) : a;
}
static int dgfem_shelli_is_finite3(dgfem_vec3 a) {
    return dgfem_shelli_is_finite(a.x) && dgfem_shelli_is_finite(a.y) && dgfem_shelli_is_finite(a.z);
}

static dgfem_mat3 dgfem_shelli_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}
static dgfem_vec3 dgfem_shelli_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_shelli_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                             a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                             a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}
static dgfem_vec3 dgfem_shelli_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_shelli_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                             a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                             a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}
static dgfem_mat3 dgfem_shelli_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}
static dgfem_mat3 dgfem_shelli_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}
/* a += s u v^T */
static void dgfem_shelli_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 su = dgfem_shelli_scale(s, u);
    a->m[0][0] += su.x * v.x, a->m[0][1] += su.x * v.y, a->m[0][2] += su.x * v.z;
    a->m[1][0] += su.y * v.x, a->m[1][1] += su.y * v.y, a->m[1][2] += su.y * v.z;
    a->m[2][0] += su.z * v.x, a->m[2][1] += su.z * v.y, a->m[2][2] += su.z * v.z;
}
/* [v]x, the matrix of w -> v x w */
static dgfem_mat3 dgfem_shelli_cross_matrix(dgfem_vec3 v) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][1] = -v.z, a.m[0][2] = v.y;
    a.m[1][0] = v.z, a.m[1][2] = -v.x;
    a.m[2][0] = -v.y, a.m[2][1] = v.x;
    return a;
}
/* Rotation by an angle about a unit axis. */
static dgfem_mat3 dgfem_shelli_rotation(dgfem_vec3 axis, dgfem_real angle) {
    dgfem_real c = (dgfem_real)cos((double)angle), s = (dgfem_real)sin((double)angle);
    dgfem_mat3 r = dgfem_shelli_cross_matrix(dgfem_shelli_scale(s, axis));
    for (int i = 0; i < 3; i++) r.m[i][i] += c;
    dgfem_shelli_add_outer(&r, 1 - c, axis, axis);
    return r;
}
/* Unit axis of a rotation, and its angle in [0, pi], from the quaternion: its largest component has all digits. The
   axis of no rotation is zero. */
static dgfem_vec3 dgfem_shelli_axis_of(const dgfem_mat3 *r, dgfem_real *angle) {
    dgfem_real d[3], trace = r->m[0][0] + r->m[1][1] + r->m[2][2], v[3], w;
    int i = 0;
    for (int k = 0; k < 3; k++) d[k] = r->m[k][k];
    for (int k = 1; k < 3; k++)
        if (d[k] > d[i]) i = k;
    int j = (i + 1) % 3, k = (i + 2) % 3;
    if (trace > d[i]) { /* four times w (w, v); else four times v_i (w, v) */
        w = 1 + trace;
        for (int c = 0; c < 3; c++) v[c] = r->m[(c + 2) % 3][(c + 1) % 3] - r->m[(c + 1) % 3][(c + 2) % 3];
    } else {
        w = r->m[k][j] - r->m[j][k];
        v[i] = 1 + 2 * d[i] - trace;
        v[j] = r->m[i][j] + r->m[j][i];
        v[k] = r->m[i][k] + r->m[k][i];
    }
    dgfem_vec3 axis = dgfem_shelli_vec3(v[0], v[1], v[2]);
    if (w < 0) axis = dgfem_shelli_scale(-1, axis), w = -w;
    *angle = (dgfem_real)(2 * atan2((double)dgfem_shelli_norm(axis), (double)w));
    return dgfem_shelli_unit(axis);
}
static dgfem_real dgfem_shelli_determinant(const dgfem_mat3 *a) {
    dgfem_vec3 r[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_shelli_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    return dgfem_shelli_dot(r[0], dgfem_shelli_cross(r[1], r[2]));
}
/* Inverse of a symmetric matrix by cofactors; 0 where it has none. */
static int dgfem_shelli_invert(const dgfem_mat3 *a, dgfem_mat3 *out) {
    dgfem_vec3 r[3], c[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_shelli_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    for (int i = 0; i < 3; i++) c[i] = dgfem_shelli_cross(r[(i + 1) % 3], r[(i + 2) % 3]);
    dgfem_real det = dgfem_shelli_dot(r[0], c[0]);
    if (!(dgfem_shelli_abs(det) > 0) || !dgfem_shelli_is_finite(det)) return 0;
    for (int j = 0; j < 3; j++) {
        out->m[0][j] = c[j].x / det;
        out->m[1][j] = c[j].y / det;
        out->m[2][j] = c[j].z / det;
    }
    return 1;
}

/* ---- strided points ---- */

static dgfem_status dgfem_shelli_check_points(const dgfem_hooks *hooks, const dgfem_points_in *points,
                                              const char *what) {
    int size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    if (points->count < 0 || (points->count > 0 && !points->data))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, points->count);
    if (points->type != DGFEM_FLOAT32 && points->type != DGFEM_FLOAT64)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)points->type);
    if (points->stride && points->stride < size)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what,
                                 points->stride);
    return DGFEM_OK;
}

static dgfem_vec3 dgfem_shelli_read_point(const dgfem_points_in *points, int i) {
    size_t size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    const char *data = (const char *)points->data + (size_t)i * (points->stride ? (size_t)points->stride : size);
    float f[3];
    double d[3];
    if (points->type == DGFEM_FLOAT64) {
        memcpy(d, data, sizeof d);
        return dgfem_shelli_vec3((dgfem_real)d[0], (dgfem_real)d[1], (dgfem_real)d[2]);
    }
    memcpy(f, data, sizeof f);
    return dgfem_shelli_vec3((dgfem_real)f[0], (dgfem_real)f[1], (dgfem_real)f[2]);
}

/* ==== shape.c ===================================================================================================== */

/* Shape functions, quadrature points and sides of the two elements. */

/* Values and derivatives by the parameters (1, 2) of all shape functions at one point. */
typedef struct dgfem_shelli_basis {
    dgfem_real n[DGFEM_SHELL_MAX_NODES], d1[DGFEM_SHELL_MAX_NODES], d2[DGFEM_SHELL_MAX_NODES];
    dgfem_real d11[DGFEM_SHELL_MAX_NODES], d22[DGFEM_SHELL_MAX_NODES], d12[DGFEM_SHELL_MAX_NODES];
} dgfem_shelli_basis;

typedef struct dgfem_shelli_parameter {
    dgfem_real a, b;
} dgfem_shelli_parameter;

static dgfem_shelli_parameter dgfem_shelli_parameter_make(dgfem_real a, dgfem_real b) {
    dgfem_shelli_parameter p;
    p.a = a, p.b = b;
    return p;
}

/* Parameters of a corner. */
static dgfem_shelli_parameter dgfem_shelli_corner(int nodes, int corner) {
    static const signed char quad[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    if (nodes == 8) return dgfem_shelli_parameter_make(quad[corner][0], quad[corner][1]);
    return dgfem_shelli_parameter_make(corner == 1, corner == 2);
}

static void dgfem_shelli_quad_basis(dgfem_real x, dgfem_real y, dgfem_shelli_basis *f) {
    const dgfem_real half = DGFEM_R(0.5), quarter = DGFEM_R(0.25);
    for (int i = 0; i < 4; i++) {
        dgfem_shelli_parameter c = dgfem_shelli_corner(8, i);
        dgfem_real u = x * c.a, v = y * c.b;
        f->n[i] = quarter * (1 + u) * (1 + v) * (u + v - 1);
        f->d1[i] = quarter * c.a * (1 + v) * (2 * u + v);
        f->d2[i] = quarter * c.b * (1 + u) * (u + 2 * v);
        f->d11[i] = half * (1 + v);
        f->d22[i] = half * (1 + u);
        f->d12[i] = quarter * c.a * c.b * (1 + 2 * u + 2 * v);
    }
    for (int i = 4; i < 8; i += 2) { /* middles of b = -1 and b = 1 */
        dgfem_real s = i == 4 ? DGFEM_R(-1) : DGFEM_R(1);
        f->n[i] = half * (1 - x * x) * (1 + s * y);
        f->d1[i] = -x * (1 + s * y);
        f->d2[i] = half * s * (1 - x * x);
        f->d11[i] = -(1 + s * y);
        f->d22[i] = 0;
        f->d12[i] = -s * x;
    }
    for (int i = 5; i < 8; i += 2) { /* middles of a = 1 and a = -1 */
        dgfem_real s = i == 5 ? DGFEM_R(1) : DGFEM_R(-1);
        f->n[i] = half * (1 - y * y) * (1 + s * x);
        f->d1[i] = half * s * (1 - y * y);
        f->d2[i] = -y * (1 + s * x);
        f->d11[i] = 0;
        f->d22[i] = -(1 + s * x);
        f->d12[i] = -s * y;
    }
}

static void dgfem_shelli_triangle_basis(dgfem_real x, dgfem_real y, dgfem_shelli_basis *f) {
    static const signed char d11[6] = {4, 4, 0, -8, 0, 0}, d22[6] = {4, 0, 4, 0, 0, -8}, d12[6] = {4, 0, 0, -4, 4, -4};
    dgfem_real z = 1 - x - y;
    f->n[0] = z * (2 * z - 1), f->d1[0] = f->d2[0] = 1 - 4 * z;
    f->n[1] = x * (2 * x - 1), f->d1[1] = 4 * x - 1, f->d2[1] = 0;
    f->n[2] = y * (2 * y - 1), f->d1[2] = 0, f->d2[2] = 4 * y - 1;
    f->n[3] = 4 * x * z, f->d1[3] = 4 * (z - x), f->d2[3] = -4 * x;
    f->n[4] = 4 * x * y, f->d1[4] = 4 * y, f->d2[4] = 4 * x;
    f->n[5] = 4 * y * z, f->d1[5] = -4 * y, f->d2[5] = 4 * (z - y);
    for (int i = 0; i < 6; i++) f->d11[i] = d11[i], f->d22[i] = d22[i], f->d12[i] = d12[i];
}

static void dgfem_shelli_basis_at(int nodes, dgfem_shelli_parameter p, dgfem_shelli_basis *f) {
    memset(f, 0, sizeof *f);
    if (nodes == 8) dgfem_shelli_quad_basis(p.a, p.b, f);
    else dgfem_shelli_triangle_basis(p.a, p.b, f);
}

/* Side `side` at s in [-1, 1], in the element's own direction. */
static dgfem_shelli_parameter dgfem_shelli_side(int nodes, int side, dgfem_real s) {
    dgfem_shelli_parameter p = dgfem_shelli_corner(nodes, side);
    dgfem_shelli_parameter q = dgfem_shelli_corner(nodes, (side + 1) % (nodes / 2));
    dgfem_real u = DGFEM_R(0.5) * (1 - s), v = DGFEM_R(0.5) * (1 + s);
    return dgfem_shelli_parameter_make(u * p.a + v * q.a, u * p.b + v * q.b);
}

/* ---- quadrature ---- */

enum { DGFEM_SHELLI_EDGE_POINTS = 3 };

/* Gauss-Legendre with three points on [-1, 1]. */
static dgfem_real dgfem_shelli_gauss_point(int q) { return (dgfem_real)((q - 1) * 0.77459666924148337704); }
static dgfem_real dgfem_shelli_gauss_weight(int q) { return (dgfem_real)(q == 1 ? 8.0 / 9 : 5.0 / 9); }

/* Points of the membrane and bending terms: 2 x 2 Gauss, for triangles 3 inside. More points lock. */
static int dgfem_shelli_point_count(int nodes) { return nodes == 8 ? 4 : 3; }

static dgfem_shelli_parameter dgfem_shelli_quadrature(int nodes, int q, dgfem_real *weight) {
    const dgfem_real g = (dgfem_real)0.57735026918962576451;
    *weight = nodes == 8 ? DGFEM_R(1) : (dgfem_real)(1.0 / 6);
    if (nodes == 8) return dgfem_shelli_parameter_make(q & 1 ? g : -g, q & 2 ? g : -g);
    return dgfem_shelli_parameter_make((dgfem_real)(q == 1 ? 2.0 / 3 : 1.0 / 6),
                                       (dgfem_real)(q == 2 ? 2.0 / 3 : 1.0 / 6));
}

/* Points for area, mass and loads: 3 x 3 Gauss, for triangles 7 of degree 5. */
static int dgfem_shelli_fine_count(int nodes) { return nodes == 8 ? 9 : 7; }

static dgfem_shelli_parameter dgfem_shelli_fine(int nodes, int q, dgfem_real *weight) {
    if (nodes == 8) {
        *weight = dgfem_shelli_gauss_weight(q % 3) * dgfem_shelli_gauss_weight(q / 3);
        return dgfem_shelli_parameter_make(dgfem_shelli_gauss_point(q % 3), dgfem_shelli_gauss_point(q / 3));
    }
    const double root = 3.87298334620741688518; /* sqrt(15) */
    int far = q > 3;
    double small = far ? (6 + root) / 21 : (6 - root) / 21, large = 1 - 2 * small;
    if (q == 0) {
        *weight = (dgfem_real)(9.0 / 80);
        return dgfem_shelli_parameter_make((dgfem_real)(1.0 / 3), (dgfem_real)(1.0 / 3));
    }
    *weight = (dgfem_real)(far ? (155 + root) / 2400 : (155 - root) / 2400);
    q = (q - 1) % 3;
    return dgfem_shelli_parameter_make((dgfem_real)(q == 1 ? large : small), (dgfem_real)(q == 2 ? large : small));
}

/* ---- geometry of a point of a curved element ---- */

typedef struct dgfem_shelli_frame {
    dgfem_vec3 e1, e2;        /* covariant base vectors */
    dgfem_vec3 e11, e22, e12; /* second derivatives */
    dgfem_vec3 c1, c2;        /* contravariant base vectors */
    dgfem_vec3 t;             /* unit normal */
    dgfem_real j;             /* area per parameter area */
} dgfem_shelli_frame;

static dgfem_vec3 dgfem_shelli_sum(const dgfem_real *n, const dgfem_vec3 *x, int count) {
    dgfem_vec3 sum = dgfem_shelli_scale(n[0], x[0]);
    for (int a = 1; a < count; a++) sum = dgfem_shelli_axpy(sum, n[a], x[a]);
    return sum;
}

/* x: the element's nodes. 0 where the surface has no tangent plane. */
static int dgfem_shelli_frame_at(const dgfem_shelli_basis *f, const dgfem_vec3 *x, int nodes, dgfem_shelli_frame *out) {
    out->e1 = dgfem_shelli_sum(f->d1, x, nodes);
    out->e2 = dgfem_shelli_sum(f->d2, x, nodes);
    out->e11 = dgfem_shelli_sum(f->d11, x, nodes);
    out->e22 = dgfem_shelli_sum(f->d22, x, nodes);
    out->e12 = dgfem_shelli_sum(f->d12, x, nodes);
    dgfem_vec3 n = dgfem_shelli_cross(out->e1, out->e2);
    dgfem_real g11 = dgfem_shelli_dot(out->e1, out->e1), g12 = dgfem_shelli_dot(out->e1, out->e2);
    dgfem_real g22 = dgfem_shelli_dot(out->e2, out->e2);
    out->j = dgfem_shelli_norm(n);
    if (!(out->j > DGFEM_R(1e-6) * (g11 + g22))) return 0;
    dgfem_real det = out->j * out->j;
    out->t = dgfem_shelli_scale(1 / out->j, n);
    out->c1 = dgfem_shelli_axpy(dgfem_shelli_scale(g22 / det, out->e1), -g12 / det, out->e2);
    out->c2 = dgfem_shelli_axpy(dgfem_shelli_scale(g11 / det, out->e2), -g12 / det, out->e1);
    return 1;
}

/* ==== mesh.c ====================================================================================================== */

/* From vertices and polygons to elements with middle nodes and edges. */

DGFEM_API dgfem_shell_desc dgfem_default_shell_desc(void) {
    dgfem_shell_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.nodes_per_quad = 4;
    desc.nodes_per_triangle = 3;
    desc.thickness = DGFEM_R(0.001);
    desc.material.young = DGFEM_R(1e9);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.eta_quad = 2;
    desc.eta_triangle = 1;
    desc.gravity.z = DGFEM_R(-9.81);
    desc.corotational = 1;
    desc.step_iterations = 4;
    desc.step_tolerance = DGFEM_R(1e-4);
    return desc;
}

/* ---- checks ---- */

static dgfem_status dgfem_shelli_check_material(const dgfem_hooks *hooks, const dgfem_material *m, dgfem_real thickness,
                                                int element) {
    if (!(m->young > 0) || !dgfem_shelli_is_finite(m->young))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Young's modulus %g, expected > 0", element,
                                 (double)m->young);
    if (!(m->poisson > -1 && m->poisson < DGFEM_R(0.5)) && !(m->poisson == DGFEM_R(0.5)))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: Poisson's ratio %g, expected in (-1, 0.5]",
                                 element, (double)m->poisson);
    if (!(m->density > 0) || !dgfem_shelli_is_finite(m->density))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: density %g, expected > 0", element,
                                 (double)m->density);
    if (!(thickness > 0) || !dgfem_shelli_is_finite(thickness))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: thickness %g, expected > 0", element,
                                 (double)thickness);
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_scalar(const dgfem_hooks *hooks, dgfem_real value, int positive,
                                              const char *what) {
    if ((positive ? value > 0 : value >= 0) && dgfem_shelli_is_finite(value)) return DGFEM_OK;
    return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s is %g, expected %s 0", what, (double)value,
                             positive ? ">" : ">=");
}

static dgfem_status dgfem_shelli_check_numbers(const dgfem_shell_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_shelli_check_scalar(hooks, desc->eta_quad, 1, "eta_quad");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->eta_triangle, 1, "eta_triangle");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping_mass, 0, "damping_mass");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping_stiffness, 0, "damping_stiffness");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->step_tolerance, 0, "step_tolerance");
    if (!status && desc->step_iterations < 1)
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "step_iterations is %d, expected >= 1",
                                   desc->step_iterations);
    if (!status && !dgfem_shelli_is_finite3(desc->gravity))
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_NOT_FINITE, "gravity (%g, %g, %g)", (double)desc->gravity.x,
                                   (double)desc->gravity.y, (double)desc->gravity.z);
    for (int e = 0; !status && e < desc->quad_count + desc->triangle_count; e++)
        status = dgfem_shelli_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material,
                                             desc->thicknesses ? desc->thicknesses[e] : desc->thickness, e);
    return status;
}

static dgfem_status dgfem_shelli_check_desc(const dgfem_shell_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_shelli_check_points(hooks, &desc->vertices, "vertices");
    if (status) return status;
    if (desc->quad_count < 0 || (desc->quad_count > 0 && !desc->quads))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "no indices of %d quads", desc->quad_count);
    if (desc->triangle_count < 0 || (desc->triangle_count > 0 && !desc->triangles))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "no indices of %d triangles", desc->triangle_count);
    /* Fewer are too many for the matrix; with these limits no count on the way there leaves an int. */
    if (desc->quad_count > INT_MAX / 128 || desc->triangle_count > INT_MAX / 128 || desc->vertices.count > INT_MAX / 2)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d quads, %d triangles and %d vertices are too many",
                                 desc->quad_count, desc->triangle_count, desc->vertices.count);
    if (desc->quad_count + desc->triangle_count == 0) return dgfem_shelli_fail(hooks, DGFEM_ERROR_EMPTY, "no elements");
    if ((desc->nodes_per_quad != 4 && desc->nodes_per_quad != 8) ||
        (desc->nodes_per_triangle != 3 && desc->nodes_per_triangle != 6))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d nodes per quad, %d per triangle",
                                 desc->nodes_per_quad, desc->nodes_per_triangle);
    if (desc->quad_count && desc->triangle_count && (desc->nodes_per_quad == 8) != (desc->nodes_per_triangle == 6))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "middle nodes are given for one kind of element only");
    return dgfem_shelli_check_numbers(desc);
}

/* ---- elements ---- */

static int dgfem_shelli_is_quad(const dgfem_shell_element *element) { return element->node_count == 8; }
static int dgfem_shelli_corners(const dgfem_shell_element *element) { return element->node_count / 2; }

static void dgfem_shelli_gather(const dgfem_vec3 *x, const int *nodes, int count, dgfem_vec3 *out) {
    int a = 0;
    do out[a] = x[nodes[a]]; /* there is always one: compilers see that `out` is set */
    while (++a < count);
}

static dgfem_status dgfem_shelli_check_element(const dgfem_hooks *hooks, const dgfem_shell_element *element, int e,
                                               int given, int vertex_count) {
    for (int a = 0; a < given; a++) {
        if (element->node[a] < 0 || element->node[a] >= vertex_count)
            return dgfem_shelli_fail(hooks, DGFEM_ERROR_INDEX, "element %d: vertex %d of %d", e, element->node[a],
                                     vertex_count);
        for (int b = 0; b < a; b++)
            if (element->node[a] == element->node[b])
                return dgfem_shelli_fail(hooks, DGFEM_ERROR_DEGENERATE, "element %d has the vertex %d twice", e,
                                         element->node[a]);
    }
    return DGFEM_OK;
}

/* Copies indices, thickness and material. *given: whether middle nodes are given. */
static dgfem_status dgfem_shelli_read_elements(dgfem_shell *shell, const dgfem_shell_desc *desc, int *given) {
    *given = desc->quad_count ? desc->nodes_per_quad == 8 : desc->nodes_per_triangle == 6;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        int quad = e < desc->quad_count, count = quad ? desc->nodes_per_quad : desc->nodes_per_triangle;
        const int *from = quad ? desc->quads + (size_t)e * (size_t)count
                               : desc->triangles + (size_t)(e - desc->quad_count) * (size_t)count;
        element->node_count = quad ? 8 : 6;
        memcpy(element->node, from, (size_t)count * sizeof(int));
        element->tag = e;
        element->thickness = desc->thicknesses ? desc->thicknesses[e] : desc->thickness;
        element->material = desc->materials ? desc->materials[e] : desc->material;
        dgfem_status status = dgfem_shelli_check_element(&desc->hooks, element, e, count, desc->vertices.count);
        if (status) return status;
    }
    return DGFEM_OK;
}

/* ---- middle nodes ---- */

/* Open addressing from the corners of an edge to its middle node. */
typedef struct dgfem_shelli_pair {
    int a, b, middle; /* a < b; middle is 0 in an empty slot: numbers are kept plus one */
} dgfem_shelli_pair;

static dgfem_shelli_pair *dgfem_shelli_find_pair(dgfem_shelli_pair *table, size_t mask, int a, int b) {
    if (a > b) {
        int swap = a;
        a = b, b = swap;
    }
    uint64_t key = ((uint64_t)(uint32_t)a << 32 | (uint32_t)b) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & mask;; slot = (slot + 1) & mask) {
        dgfem_shelli_pair *pair = &table[slot];
        if (!pair->middle) pair->a = a, pair->b = b;
        if (!pair->middle || (pair->a == a && pair->b == b)) return pair;
    }
}

static size_t dgfem_shelli_pair_table_size(const dgfem_shell *shell) {
    size_t size = 16;
    while (size < 8 * (size_t)shell->element_count) size *= 2;
    return size;
}

/* Numbers a middle node for every edge, behind the vertices. Returns the number of all nodes, 0 when out of memory. */
static int dgfem_shelli_number_middles(dgfem_shell *shell, int vertex_count) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    size_t size = dgfem_shelli_pair_table_size(shell);
    int next = vertex_count;
    dgfem_shelli_pair *table = (dgfem_shelli_pair *)dgfem_shelli_take(&scratch, size, sizeof *table);
    if (!table) return 0;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            dgfem_shelli_pair *pair =
                dgfem_shelli_find_pair(table, size - 1, element->node[k], element->node[(k + 1) % corners]);
            if (!pair->middle) pair->middle = ++next;
            element->node[corners + k] = pair->middle - 1;
        }
    }
    dgfem_shelli_scratch_free(&scratch);
    return next;
}

static dgfem_status dgfem_shelli_read_vertices(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    for (int i = 0; i < desc->vertices.count; i++) {
        shell->rest[i] = dgfem_shelli_read_point(&desc->vertices, i);
        if (!dgfem_shelli_is_finite3(shell->rest[i]))
            return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", i);
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_place_middles(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            dgfem_vec3 a = shell->rest[element->node[k]], b = shell->rest[element->node[(k + 1) % corners]];
            dgfem_vec3 x = dgfem_shelli_scale(DGFEM_R(0.5), dgfem_shelli_add(a, b));
            if (desc->surface) x = desc->surface(desc->surface_user, x, a, b);
            if (!dgfem_shelli_is_finite3(x))
                return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_NOT_FINITE,
                                         "element %d: the surface gave no place for the middle of side %d", e, k);
            shell->rest[element->node[corners + k]] = x;
        }
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_used(const dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    char *used = (char *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, 1);
    dgfem_status status = used ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    for (int e = 0; !status && e < shell->element_count; e++)
        for (int a = 0; a < shell->elements[e].node_count; a++) used[shell->elements[e].node[a]] = 1;
    for (int i = 0; !status && i < shell->node_count; i++)
        if (!used[i])
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "vertex %d belongs to no element", i);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- given middle nodes ---- */

/* No node is a corner of one element and a middle of another: role[i] > 0 is a corner of element role[i] - 1, < 0 a
   middle. */
static dgfem_status dgfem_shelli_check_roles(const dgfem_shell *shell, int *role) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        for (int a = 0; a < element->node_count; a++) {
            int corner = a < dgfem_shelli_corners(element), i = element->node[a], other = role[i];
            if (other && (other > 0) != corner)
                return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                         "vertex %d is a corner of element %d and the middle of a side of element %d",
                                         i, corner ? e : other - 1, corner ? -other - 1 : e);
            role[i] = corner ? e + 1 : -e - 1;
        }
    }
    return DGFEM_OK;
}

/* No two sides between the same corners have different middles. */
static dgfem_status dgfem_shelli_check_middles(const dgfem_shell *shell, dgfem_shelli_pair *table, size_t mask) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            int a = element->node[k], b = element->node[(k + 1) % corners], middle = element->node[corners + k];
            dgfem_shelli_pair *pair = dgfem_shelli_find_pair(table, mask, a, b);
            if (pair->middle && pair->middle != middle + 1)
                return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                         "element %d: the side of vertices %d and %d has the middle node %d, that of "
                                         "another element %d",
                                         e, a, b, middle, pair->middle - 1);
            pair->middle = middle + 1;
        }
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_given(const dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    size_t size = dgfem_shelli_pair_table_size(shell);
    int *role = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    dgfem_shelli_pair *table = (dgfem_shelli_pair *)dgfem_shelli_take(&scratch, size, sizeof *table);
    dgfem_status status = role && table ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_shelli_check_roles(shell, role);
    if (!status) status = dgfem_shelli_check_middles(shell, table, size - 1);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- edges ---- */

static void dgfem_shelli_new_edge(dgfem_shell *shell, int e, int k, int middle) {
    dgfem_shell_edge *edge = &shell->edges[shell->edge_count];
    dgfem_shell_element *element = &shell->elements[e];
    memset(edge, 0, sizeof *edge);
    edge->node[0] = element->node[k];
    edge->node[1] = element->node[(k + 1) % dgfem_shelli_corners(element)];
    edge->node[2] = middle;
    edge->element[0] = e, edge->element[1] = DGFEM_NONE;
    edge->side[0] = k, edge->side[1] = DGFEM_NONE;
    edge->loop = edge->support = DGFEM_NONE;
    element->edge[k] = shell->edge_count++;
}

static dgfem_status dgfem_shelli_join_edge(dgfem_shell *shell, int e, int k, int index) {
    dgfem_shell_edge *edge = &shell->edges[index];
    dgfem_shell_element *element = &shell->elements[e];
    int a = element->node[k], b = element->node[(k + 1) % dgfem_shelli_corners(element)];
    if (edge->element[1] != DGFEM_NONE)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                 "the edge of vertices %d and %d belongs to elements %d, %d and %d", a, b,
                                 edge->element[0], edge->element[1], e);
    if (edge->node[0] == a && edge->node[1] == b)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INSIDE_OUT,
                                 "elements %d and %d run the same way along the edge of vertices %d and %d",
                                 edge->element[0], e, a, b);
    if (edge->node[0] != b || edge->node[1] != a || edge->element[0] == e)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_CONFORMING,
                                 "elements %d and %d share the middle node %d of different edges", edge->element[0], e,
                                 edge->node[2]);
    edge->element[1] = e;
    edge->side[1] = k;
    element->edge[k] = index;
    return DGFEM_OK;
}

static int dgfem_shelli_is_boundary(const dgfem_shell_edge *edge) { return edge->element[1] == DGFEM_NONE; }

/* The boundary edge that follows: around the end node through the elements, as far as they hang together by edges. */
static int dgfem_shelli_next_boundary(const dgfem_shell *shell, int edge) {
    int e = shell->edges[edge].element[0], side = shell->edges[edge].side[0];
    for (;;) {
        int next = shell->elements[e].edge[(side + 1) % dgfem_shelli_corners(&shell->elements[e])];
        const dgfem_shell_edge *candidate = &shell->edges[next];
        if (dgfem_shelli_is_boundary(candidate)) return next;
        int other = candidate->element[0] == e;
        e = candidate->element[other];
        side = candidate->side[other];
    }
}

/* Numbers the loops of the boundary in the order of their lowest edges. */
static void dgfem_shelli_number_loops(dgfem_shell *shell) {
    int loops = 0;
    for (int first = 0; first < shell->edge_count; first++) {
        int edge = first;
        if (!dgfem_shelli_is_boundary(&shell->edges[first]) || shell->edges[first].loop != DGFEM_NONE) continue;
        do {
            shell->edges[edge].loop = loops;
            edge = dgfem_shelli_next_boundary(shell, edge);
        } while (edge != first);
        loops++;
    }
}

/* Finds all edges by their middle nodes: shell->edges has room for one per side. */
static dgfem_status dgfem_shelli_connect(dgfem_shell *shell) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    int *edge_of = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    dgfem_status status = edge_of ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    shell->edge_count = 0;
    for (int i = 0; !status && i < shell->node_count; i++) edge_of[i] = DGFEM_NONE;
    for (int e = 0; !status && e < shell->element_count; e++) {
        int corners = dgfem_shelli_corners(&shell->elements[e]);
        for (int k = 0; !status && k < corners; k++) {
            int middle = shell->elements[e].node[corners + k];
            if (edge_of[middle] != DGFEM_NONE) {
                status = dgfem_shelli_join_edge(shell, e, k, edge_of[middle]);
            } else {
                edge_of[middle] = shell->edge_count;
                dgfem_shelli_new_edge(shell, e, k, middle);
            }
        }
    }
    if (!status) dgfem_shelli_number_loops(shell);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

/* ---- measures ---- */

/* Length of a side at rest. */
static dgfem_real dgfem_shelli_side_length(const dgfem_vec3 *x, int n, int side) {
    dgfem_shelli_parameter p = dgfem_shelli_corner(n, side), r = dgfem_shelli_corner(n, (side + 1) % (n / 2));
    dgfem_real length = 0;
    for (int q = 0; q < DGFEM_SHELLI_EDGE_POINTS; q++) {
        dgfem_shelli_basis f;
        dgfem_shelli_basis_at(n, dgfem_shelli_side(n, side, dgfem_shelli_gauss_point(q)), &f);
        dgfem_vec3 tangent = dgfem_shelli_axpy(dgfem_shelli_scale((r.a - p.a) / 2, dgfem_shelli_sum(f.d1, x, n)),
                                               (r.b - p.b) / 2, dgfem_shelli_sum(f.d2, x, n));
        length += dgfem_shelli_gauss_weight(q) * dgfem_shelli_norm(tangent);
    }
    return length;
}

/* Area and perimeter of one element; part[a] and load[a]: integrals of N_a^2 and N_a. 0 where it is degenerate. */
static int dgfem_shelli_measure_element(const dgfem_shell *shell, dgfem_shell_element *element, dgfem_real *part,
                                        dgfem_real *load) {
    int n = element->node_count;
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_gather(shell->rest, element->node, n, x);
    element->area = element->perimeter = 0;
    for (int a = 0; a < n; a++) part[a] = load[a] = 0;
    for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
        dgfem_shelli_basis f;
        dgfem_shelli_frame frame;
        dgfem_real weight;
        dgfem_shelli_basis_at(n, dgfem_shelli_fine(n, q, &weight), &f);
        if (!dgfem_shelli_frame_at(&f, x, n, &frame)) return 0;
        element->area += weight * frame.j;
        for (int a = 0; a < n; a++) {
            part[a] += weight * frame.j * f.n[a] * f.n[a];
            load[a] += weight * frame.j * f.n[a];
        }
    }
    for (int k = 0; k < n / 2; k++) element->perimeter += dgfem_shelli_side_length(x, n, k);
    return 1;
}

/* 1 where the corners' normals are on the side of the one at the centre: neither concave nor tangled. */
static int dgfem_shelli_is_convex(const dgfem_vec3 *x, int n) {
    dgfem_real third = n == 8 ? 0 : DGFEM_R(1.0) / 3;
    dgfem_shelli_basis f;
    dgfem_shelli_frame centre, corner;
    dgfem_shelli_basis_at(n, dgfem_shelli_parameter_make(third, third), &f);
    if (!dgfem_shelli_frame_at(&f, x, n, &centre)) return 0;
    for (int k = 0; k < n / 2; k++) {
        dgfem_shelli_basis_at(n, dgfem_shelli_corner(n, k), &f);
        if (!dgfem_shelli_frame_at(&f, x, n, &corner) || !(dgfem_shelli_dot(corner.t, centre.t) > 0)) return 0;
    }
    return 1;
}

/* For a mesh that is given: pieces that cuts leave are taken as they are. */
static dgfem_status dgfem_shelli_check_convex(const dgfem_shell *shell) {
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_gather(shell->rest, element->node, element->node_count, x);
        if (!dgfem_shelli_is_convex(x, element->node_count))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "element %d is concave or tangled", e);
    }
    return DGFEM_OK;
}

/* Measures of all elements, and what each node has of them: area and mass in proportion to the integral of N^2. */
static dgfem_status dgfem_shelli_measure(dgfem_shell *shell) {
    for (int i = 0; i < shell->node_count; i++) {
        shell->node_area[i] = shell->node_mass[i] = shell->node_load[i] = 0;
        shell->node_half[i] = shell->node_spring[i] = 0;
    }
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_shell_element *element = &shell->elements[e];
        dgfem_real part[DGFEM_SHELL_MAX_NODES], load[DGFEM_SHELL_MAX_NODES], total = 0, h = element->thickness;
        if (!dgfem_shelli_measure_element(shell, element, part, load))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_DEGENERATE, "element %d has no tangent plane", e);
        for (int a = 0; a < element->node_count; a++) total += part[a];
        for (int a = 0; a < element->node_count; a++) {
            dgfem_real area = element->area * part[a] / total;
            int i = element->node[a];
            shell->node_area[i] += area;
            shell->node_mass[i] += area * h * element->material.density;
            shell->node_load[i] += load[a] * h * element->material.density;
            shell->node_half[i] = dgfem_shelli_max(shell->node_half[i], h / 2);
            shell->node_spring[i] = dgfem_shelli_max(shell->node_spring[i], h * element->material.young);
        }
    }
    return DGFEM_OK;
}

/* ---- boundary ---- */

DGFEM_API int dgfem_shell_boundary(const dgfem_shell *shell, int *edges, int *loop_start) {
    int loops = 0, count = 0;
    if (!shell) return 0;
    for (int first = 0; first < shell->edge_count; first++) {
        int edge = first;
        if (shell->edges[first].loop != loops) continue; /* a loop is written from its lowest edge */
        if (loop_start) loop_start[loops] = count;
        loops++;
        do {
            if (edges) edges[count] = edge;
            count++;
            edge = dgfem_shelli_next_boundary(shell, edge);
        } while (edge != first);
    }
    if (loop_start) loop_start[loops] = count;
    return loops;
}

static int dgfem_shelli_on_plane(const dgfem_shell *shell, const dgfem_plane *plane, dgfem_real tolerance, int node) {
    dgfem_real distance = dgfem_shelli_dot(plane->normal, shell->rest[node]) - plane->offset;
    return dgfem_shelli_abs(distance) <= tolerance;
}

DGFEM_API int dgfem_shell_edges_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *edges,
                                         int capacity) {
    int count = 0;
    for (int i = 0; shell && i < shell->edge_count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[i];
        if (!dgfem_shelli_is_boundary(edge) || !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[0]) ||
            !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[1]) ||
            !dgfem_shelli_on_plane(shell, &plane, tolerance, edge->node[2]))
            continue;
        if (edges && count < capacity) edges[count] = i;
        count++;
    }
    return count;
}

DGFEM_API int dgfem_shell_nodes_on_plane(const dgfem_shell *shell, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                         int capacity) {
    int count = 0;
    for (int i = 0; shell && i < shell->node_count; i++) {
        if (!dgfem_shelli_on_plane(shell, &plane, tolerance, i)) continue;
        if (nodes && count < capacity) nodes[count] = i;
        count++;
    }
    return count;
}

DGFEM_API int dgfem_shell_nearest_node(const dgfem_shell *shell, dgfem_vec3 x) {
    int nearest = DGFEM_NONE;
    dgfem_real best = 0;
    for (int i = 0; shell && i < shell->node_count; i++) {
        dgfem_vec3 d = dgfem_shelli_sub(shell->position[i], x);
        dgfem_real square = dgfem_shelli_dot(d, d);
        if (nearest == DGFEM_NONE || square < best) nearest = i, best = square;
    }
    return nearest;
}

/* ==== element.c =================================================================================================== */

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

/* ==== edge.c ====================================================================================================== */

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

/* ==== corotation.c ================================================================================================ */

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

/* ==== system.c ==================================================================================================== */

/* The groups of all elements and edges, the block matrix of the nodes, and the shell's creation. */

/* Work vectors of all nodes. */
enum {
    DGFEM_SHELLI_X, /* trial positions */
    DGFEM_SHELLI_V, /* trial velocities */
    DGFEM_SHELLI_RESIDUAL,
    DGFEM_SHELLI_FORCE,
    DGFEM_SHELLI_RHS,
    DGFEM_SHELLI_SOLUTION,
    DGFEM_SHELLI_MOTION, /* prescribed part of an increment */
    DGFEM_SHELLI_BEST,
    DGFEM_SHELLI_KRYLOV, /* and what follows: an orthonormal basis */
    DGFEM_SHELLI_VECTORS = DGFEM_SHELLI_KRYLOV + 10
};

static dgfem_vec3 *dgfem_shelli_vector(const dgfem_shell *shell, int k) {
    return (dgfem_vec3 *)(void *)shell->system->work + (size_t)k * (size_t)shell->node_count;
}
static const dgfem_real *dgfem_shelli_reals(const dgfem_vec3 *x) { return (const dgfem_real *)(const void *)x; }
static dgfem_real *dgfem_shelli_reals_of(dgfem_vec3 *x) { return (dgfem_real *)(void *)x; }

/* ---- groups ---- */

static int dgfem_shelli_edge_has_group(const dgfem_shell_edge *edge) {
    return dgfem_shelli_is_boundary(edge) || edge->joint == DGFEM_SHELL_GLUED;
}

static void dgfem_shelli_count_groups(const dgfem_shell *shell, dgfem_shell_system *system) {
    for (int e = 0; e < shell->element_count; e++) {
        system->group_count++;
        system->point_count += dgfem_shelli_point_count(shell->elements[e].node_count);
    }
    for (int i = 0; i < shell->edge_count; i++) {
        if (!dgfem_shelli_edge_has_group(&shell->edges[i])) continue;
        system->group_count++;
        system->point_count += DGFEM_SHELLI_EDGE_POINTS;
    }
}

/* The nodes of all sides, each once. */
static void dgfem_shelli_group_nodes(const dgfem_shell *shell, dgfem_shelli_group *group, int *nodes) {
    group->node_count = 0;
    for (int side = 0; side < group->sides; side++) {
        const dgfem_shell_element *element = &shell->elements[group->element[side]];
        for (int a = 0; a < element->node_count; a++) {
            int at = 0;
            while (at < group->node_count && nodes[at] != element->node[a]) at++;
            if (at == group->node_count) nodes[group->node_count++] = element->node[a];
            group->local[side][a] = (signed char)at;
        }
    }
}

static size_t dgfem_shelli_pairs(const dgfem_shelli_group *group) {
    return (size_t)group->node_count * ((size_t)group->node_count + 1) / 2;
}

typedef struct dgfem_shelli_totals {
    size_t strains, gradients, pairs;
} dgfem_shelli_totals;

static void dgfem_shelli_add_group(const dgfem_shell *shell, dgfem_shell_system *system, dgfem_shelli_kind kind,
                                   int owner, const int *elements, int points, dgfem_shelli_totals *totals) {
    dgfem_shelli_group *group = &system->groups[system->group_count++];
    group->kind = kind;
    group->owner = owner;
    group->element[0] = elements[0];
    group->element[1] = kind == DGFEM_SHELLI_GLUE ? elements[1] : DGFEM_NONE;
    group->sides = kind == DGFEM_SHELLI_GLUE ? 2 : 1;
    group->node_start = system->node_total;
    dgfem_shelli_group_nodes(shell, group, system->nodes + group->node_start);
    system->node_total += group->node_count;
    group->point_start = system->point_count;
    group->point_count = points;
    group->map_start = totals->pairs;
    totals->pairs += dgfem_shelli_pairs(group);
    for (int q = 0; q < points; q++) {
        dgfem_shelli_point *point = &system->points[system->point_count++];
        point->strain_start = totals->strains;
        point->gradient_start = totals->gradients;
        totals->strains += (size_t)(dgfem_shelli_rows(group) * 3 * group->node_count);
        totals->gradients += (size_t)group->node_count;
    }
}

static int dgfem_shelli_lay_out(const dgfem_shell *shell, dgfem_shell_system *system, dgfem_shelli_totals *totals) {
    const dgfem_hooks *hooks = &shell->hooks;
    dgfem_shelli_count_groups(shell, system);
    size_t groups = (size_t)system->group_count, points = (size_t)system->point_count;
    system->groups = (dgfem_shelli_group *)dgfem_shelli_allocate(hooks, groups, sizeof *system->groups);
    system->points = (dgfem_shelli_point *)dgfem_shelli_allocate(hooks, points, sizeof *system->points);
    system->nodes = (int *)dgfem_shelli_allocate(hooks, DGFEM_SHELLI_MAX_GROUP * groups, sizeof(int));
    system->rotations = (dgfem_mat3 *)dgfem_shelli_allocate(hooks, points, sizeof(dgfem_mat3));
    system->strain_before =
        (dgfem_real *)dgfem_shelli_allocate(hooks, points, DGFEM_SHELLI_MAX_ROWS * sizeof(dgfem_real));
    if (!system->groups || !system->points || !system->nodes || !system->rotations || !system->strain_before) return 0;
    for (int q = 0; q < system->point_count; q++) system->rotations[q] = dgfem_shelli_identity();
    system->group_count = system->point_count = 0;
    for (int e = 0; e < shell->element_count; e++)
        dgfem_shelli_add_group(shell, system, DGFEM_SHELLI_ELEMENT, e, &e,
                               dgfem_shelli_point_count(shell->elements[e].node_count), totals);
    for (int i = 0; i < shell->edge_count; i++)
        if (dgfem_shelli_edge_has_group(&shell->edges[i]))
            dgfem_shelli_add_group(
                shell, system, dgfem_shelli_is_boundary(&shell->edges[i]) ? DGFEM_SHELLI_BOUNDARY : DGFEM_SHELLI_GLUE,
                i, shell->edges[i].element, DGFEM_SHELLI_EDGE_POINTS, totals);
    system->strains = (dgfem_real *)dgfem_shelli_allocate(hooks, totals->strains, sizeof(dgfem_real));
    system->gradients = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, totals->gradients, sizeof(dgfem_vec3));
    system->group_force = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, (size_t)system->node_total, sizeof(dgfem_vec3));
    system->group_energy = (dgfem_real *)dgfem_shelli_allocate(hooks, groups, sizeof(dgfem_real));
    system->dense_count = !hooks->parallel_for ? 1 : system->group_count < 128 ? system->group_count : 128;
    system->dense = (dgfem_real *)dgfem_shelli_allocate(hooks, (size_t)system->dense_count * DGFEM_SHELLI_DENSE,
                                                        sizeof(dgfem_real));
    system->map = (size_t *)dgfem_shelli_allocate(hooks, totals->pairs, sizeof(size_t));
    return system->strains && system->gradients && system->map && system->group_force && system->group_energy &&
           system->dense;
}

/* ---- matrix ---- */

static void dgfem_shelli_fill_pairs(const dgfem_shell_system *system, int *pairs) {
    for (int g = 0; g < system->group_count; g++) {
        const int *nodes = system->nodes + system->groups[g].node_start;
        for (int a = 0; a < system->groups[g].node_count; a++)
            for (int b = 0; b <= a; b++) *pairs++ = nodes[a], *pairs++ = nodes[b];
    }
}

static void dgfem_shelli_fill_map(dgfem_shell_system *system) {
    size_t *map = system->map;
    for (int g = 0; g < system->group_count; g++) {
        const int *nodes = system->nodes + system->groups[g].node_start;
        for (int a = 0; a < system->groups[g].node_count; a++)
            for (int b = 0; b <= a; b++) {
                int row = nodes[a] > nodes[b] ? nodes[a] : nodes[b], column = nodes[a] + nodes[b] - row;
                *map++ = (size_t)(dgfem_matrix_block(system->matrix, row, column) - system->matrix->values);
            }
    }
}

static dgfem_status dgfem_shelli_create_matrix(const dgfem_shell *shell, dgfem_shell_system *system, size_t pairs) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    if (pairs > (size_t)INT_MAX / 8)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "%d elements are too many", shell->element_count);
    int *sizes = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int));
    int *list = (int *)dgfem_shelli_take(&scratch, 2 * pairs, sizeof(int));
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && list) {
        for (int i = 0; i < shell->node_count; i++) sizes[i] = 3;
        dgfem_shelli_fill_pairs(system, list);
        desc.block_count = shell->node_count;
        desc.block_sizes = sizes;
        desc.pairs = list;
        desc.pair_count = (int)pairs;
        desc.centres = shell->rest;
        desc.hooks = shell->hooks;
        desc.hooks.log = NULL; /* the shell has its own line */
        status = dgfem_matrix_create(&desc, &system->matrix);
    }
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

static dgfem_status dgfem_shelli_create_solver(const dgfem_shell *shell, dgfem_shell_system *system, size_t pairs) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t nodes = (size_t)shell->node_count;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_status status = dgfem_shelli_create_matrix(shell, system, pairs);
    if (status) return status;
    desc.hooks = *hooks;
    desc.hooks.log = NULL; /* a tangent that is not positive definite is no news: the step is shifted */
    status = dgfem_cholesky_create(system->matrix, &desc, &system->cholesky);
    if (status) return status;
    dgfem_shelli_fill_map(system);
    system->diagonal = (size_t *)dgfem_shelli_allocate(hooks, nodes, sizeof(size_t));
    system->held = (char *)dgfem_shelli_allocate(hooks, nodes, 1);
    system->free_part = (dgfem_mat3 *)dgfem_shelli_allocate(hooks, nodes, sizeof(dgfem_mat3));
    system->target = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, nodes, sizeof(dgfem_vec3));
    system->work = (dgfem_real *)dgfem_shelli_allocate(hooks, DGFEM_SHELLI_VECTORS * nodes, sizeof(dgfem_vec3));
    if (!system->diagonal || !system->held || !system->free_part || !system->target || !system->work)
        return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < shell->node_count; i++)
        system->diagonal[i] = (size_t)(dgfem_matrix_block(system->matrix, i, i) - system->matrix->values);
    return DGFEM_OK;
}

static void dgfem_shelli_system_destroy(const dgfem_hooks *hooks, dgfem_shell_system *system) {
    if (!system) return;
    dgfem_shelli_free(hooks, system->groups);
    dgfem_shelli_free(hooks, system->points);
    dgfem_shelli_free(hooks, system->nodes);
    dgfem_shelli_free(hooks, system->strains);
    dgfem_shelli_free(hooks, system->gradients);
    dgfem_shelli_free(hooks, system->map);
    dgfem_shelli_free(hooks, system->rotations);
    dgfem_shelli_free(hooks, system->strain_before);
    dgfem_shelli_free(hooks, system->group_force);
    dgfem_shelli_free(hooks, system->group_energy);
    dgfem_shelli_free(hooks, system->dense);
    dgfem_shelli_free(hooks, system->diagonal);
    dgfem_shelli_free(hooks, system->held);
    dgfem_shelli_free(hooks, system->free_part);
    dgfem_shelli_free(hooks, system->target);
    dgfem_shelli_free(hooks, system->work);
    dgfem_matrix_destroy(system->matrix);
    dgfem_cholesky_destroy(system->cholesky);
    dgfem_shelli_free(hooks, system);
}

/* Everything that follows from nodes, elements and edges. On failure shell->system is what could be made. */
static dgfem_status dgfem_shelli_system_create(dgfem_shell *shell) {
    dgfem_shell_system *system = (dgfem_shell_system *)dgfem_shelli_allocate(&shell->hooks, 1, sizeof *system);
    dgfem_shelli_totals totals;
    memset(&totals, 0, sizeof totals);
    shell->system = system;
    if (!system) return DGFEM_ERROR_MEMORY;
    system->part = 1;
    dgfem_shelli_tabulate(system->basis);
    if (!dgfem_shelli_lay_out(shell, system, &totals)) return DGFEM_ERROR_MEMORY;
    for (int g = 0; g < system->group_count; g++) {
        const dgfem_shelli_group *group = &system->groups[g];
        dgfem_status status = group->kind == DGFEM_SHELLI_ELEMENT ? dgfem_shelli_build_element(shell, system, group)
                                                                  : dgfem_shelli_build_edge(shell, system, group);
        if (status) return status;
    }
    return dgfem_shelli_create_solver(shell, system, totals.pairs);
}

/* ---- creation ---- */

/* What belongs to one topology: arrays by node, element and edge, and the system. */
static void dgfem_shelli_free_topology(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    dgfem_shelli_free(hooks, shell->rest);
    dgfem_shelli_free(hooks, shell->position);
    dgfem_shelli_free(hooks, shell->velocity);
    dgfem_shelli_free(hooks, shell->node_area);
    dgfem_shelli_free(hooks, shell->node_mass);
    dgfem_shelli_free(hooks, shell->node_load);
    dgfem_shelli_free(hooks, shell->node_half);
    dgfem_shelli_free(hooks, shell->node_spring);
    dgfem_shelli_free(hooks, shell->elements);
    dgfem_shelli_free(hooks, shell->edges);
    dgfem_shelli_system_destroy(hooks, shell->system);
}

static int dgfem_shelli_allocate_nodes(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t n = (size_t)shell->node_count;
    shell->rest = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->position = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->velocity = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_vec3));
    shell->node_area = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_mass = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_load = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_half = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    shell->node_spring = (dgfem_real *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_real));
    return shell->rest && shell->position && shell->velocity && shell->node_area && shell->node_mass &&
           shell->node_load && shell->node_half && shell->node_spring;
}

static int dgfem_shelli_allocate_elements(dgfem_shell *shell) {
    const dgfem_hooks *hooks = &shell->hooks;
    size_t n = (size_t)shell->element_count;
    shell->elements = (dgfem_shell_element *)dgfem_shelli_allocate(hooks, n, sizeof(dgfem_shell_element));
    shell->edges = (dgfem_shell_edge *)dgfem_shelli_allocate(hooks, 4 * n, sizeof(dgfem_shell_edge));
    return shell->elements && shell->edges;
}

static dgfem_status dgfem_shelli_build(dgfem_shell *shell, const dgfem_shell_desc *desc) {
    int given;
    shell->element_count = desc->quad_count + desc->triangle_count;
    if (!dgfem_shelli_allocate_elements(shell)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_shelli_read_elements(shell, desc, &given);
    if (status) return status;
    shell->node_count = given ? desc->vertices.count : dgfem_shelli_number_middles(shell, desc->vertices.count);
    if (!shell->node_count || !dgfem_shelli_allocate_nodes(shell)) return DGFEM_ERROR_MEMORY;
    status = dgfem_shelli_read_vertices(shell, desc);
    if (!status && !given) status = dgfem_shelli_place_middles(shell, desc);
    if (!status) status = dgfem_shelli_check_used(shell);
    if (!status && given) status = dgfem_shelli_check_given(shell);
    if (!status) status = dgfem_shelli_connect(shell);
    if (!status) status = dgfem_shelli_measure(shell);
    if (!status) status = dgfem_shelli_check_convex(shell);
    if (status) return status;
    memcpy(shell->position, shell->rest, (size_t)shell->node_count * sizeof *shell->rest);
    return dgfem_shelli_system_create(shell);
}

DGFEM_API dgfem_status dgfem_shell_create(const dgfem_shell_desc *desc, dgfem_shell **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_desc(desc);
    if (status) return status;
    dgfem_shell *shell = (dgfem_shell *)dgfem_shelli_allocate(&desc->hooks, 1, sizeof *shell);
    if (!shell) return dgfem_shelli_fail_memory(&desc->hooks);
    shell->desc = *desc;
    shell->hooks = desc->hooks;
    memset(&shell->desc.vertices, 0, sizeof shell->desc.vertices); /* the caller's arrays need not outlive this call */
    shell->desc.quads = shell->desc.triangles = NULL;
    shell->desc.thicknesses = NULL;
    shell->desc.materials = NULL;
    status = dgfem_shelli_build(shell, desc);
    if (status) {
        dgfem_shell_destroy(shell);
        return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&desc->hooks) : status;
    }
    *out = shell;
    return DGFEM_OK;
}

DGFEM_API void dgfem_shell_destroy(dgfem_shell *shell) {
    if (!shell) return;
    dgfem_hooks hooks = shell->hooks;
    for (int i = 0; i < shell->condition_count; i++) dgfem_shelli_free(&hooks, shell->conditions[i].items);
    dgfem_shelli_free(&hooks, shell->conditions);
    dgfem_shelli_free(&hooks, shell->shapes);
    dgfem_shelli_free_topology(shell);
    dgfem_shelli_free(&hooks, shell);
}

/* ==== conditions.c ================================================================================================ */

/* What holds and loads a shell: the list of conditions and contact shapes. */

static dgfem_status dgfem_shelli_check_items(const dgfem_shell *shell, const int *items, int count, int limit,
                                             const char *what) {
    if (count < 1 || !items)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "%s %d of %d", what, items[i], limit);
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_boundary(const dgfem_shell *shell, const int *edges, int count, int support) {
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    for (int i = 0; !status && i < count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[edges[i]];
        if (!dgfem_shelli_is_boundary(edge))
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is not on the boundary", edges[i]);
        else if (support && edge->support != DGFEM_NONE)
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is held by condition %d already",
                                       edges[i], shell->conditions[edge->support].id);
    }
    return status;
}

static dgfem_status dgfem_shelli_check_vector(const dgfem_shell *shell, dgfem_vec3 v, const char *what) {
    if (dgfem_shelli_is_finite3(v)) return DGFEM_OK;
    return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                             (double)v.z);
}

static dgfem_status dgfem_shelli_check_real(const dgfem_shell *shell, dgfem_real x, const char *what) {
    if (dgfem_shelli_is_finite(x)) return DGFEM_OK;
    return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
}

/* Every part of the path is reached: the next one begins here. */
static void dgfem_shelli_settle(dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++) {
        dgfem_shell_condition *condition = &shell->conditions[c];
        condition->vector_before = condition->vector;
        condition->scalar_before = condition->scalar;
        condition->rotation_before = condition->rotation;
    }
    shell->gravity_before = shell->desc.gravity;
}

/* What condition number c says about its edges. */
static void dgfem_shelli_mark_edges(dgfem_shell *shell, int c) {
    const dgfem_shell_condition *condition = &shell->conditions[c];
    for (int i = 0; i < condition->count; i++) {
        if (condition->kind == DGFEM_SHELL_CONDITION_MOMENT) {
            dgfem_shell_edge *edge = &shell->edges[condition->items[i]];
            *(condition->follower ? &edge->follower_moment : &edge->moment) +=
                dgfem_shelli_scalar_now(shell, condition);
        } else if (condition->kind == DGFEM_SHELL_CONDITION_CLAMP ||
                   condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY ||
                   condition->kind == DGFEM_SHELL_CONDITION_ROTATION) {
            shell->edges[condition->items[i]].support = c;
        }
    }
}

/* What all conditions say. */
static void dgfem_shelli_refresh_edges(dgfem_shell *shell) {
    for (int i = 0; i < shell->edge_count; i++) {
        shell->edges[i].support = DGFEM_NONE;
        shell->edges[i].moment = shell->edges[i].follower_moment = 0;
    }
    for (int c = 0; c < shell->condition_count; c++) dgfem_shelli_mark_edges(shell, c);
}

/* Appends a condition of checked items; the caller fills in the rest of *added. */
static dgfem_status dgfem_shelli_add_condition(dgfem_shell *shell, dgfem_shell_condition_kind kind, const int *items,
                                               int count, int *id, dgfem_shell_condition **added) {
    if (shell->condition_count == shell->condition_capacity) {
        int capacity = 2 * shell->condition_capacity + 8;
        dgfem_shell_condition *grown = (dgfem_shell_condition *)dgfem_shelli_reallocate(
            &shell->hooks, shell->conditions, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_shelli_fail_memory(&shell->hooks);
        shell->conditions = grown;
        shell->condition_capacity = capacity;
    }
    int *copy = (int *)dgfem_shelli_duplicate(&shell->hooks, items, (size_t)count, sizeof(int));
    if (!copy) return dgfem_shelli_fail_memory(&shell->hooks);
    dgfem_shell_condition *condition = &shell->conditions[shell->condition_count++];
    memset(condition, 0, sizeof *condition);
    condition->id = shell->next_id++;
    condition->kind = kind;
    condition->items = copy;
    condition->count = count;
    condition->rotation = condition->rotation_before = dgfem_shelli_identity();
    if (id) *id = condition->id;
    *added = condition;
    return DGFEM_OK;
}

static dgfem_shell_condition *dgfem_shelli_find_condition(dgfem_shell *shell, int id) {
    for (int c = 0; c < shell->condition_count; c++)
        if (shell->conditions[c].id == id) return &shell->conditions[c];
    return NULL;
}

/* The condition of this id and, unless `any`, kind. */
static dgfem_status dgfem_shelli_get_condition(dgfem_shell *shell, int id, dgfem_shell_condition_kind kind, int any,
                                               dgfem_shell_condition **out) {
    *out = dgfem_shelli_find_condition(shell, id);
    if (!*out) return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "no condition has the id %d", id);
    if (!any && (*out)->kind != kind)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is of another kind", id);
    return DGFEM_OK;
}

/* ---- what holds ---- */

DGFEM_API dgfem_status dgfem_shell_fix_nodes(dgfem_shell *shell, const int *nodes, int count, int axes,
                                             dgfem_vec3 displacement, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, nodes, count, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_vector(shell, displacement, "displacement");
    if (!status && (axes < 1 || axes > DGFEM_SHELL_XYZ))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "axes %d, expected 1..7", axes);
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_FIX, nodes, count, id, &condition);
    if (status) return status;
    condition->axes = axes;
    condition->vector = displacement;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_fix_symmetry(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 normal,
                                                int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_check_vector(shell, normal, "normal");
    if (!status && !(dgfem_shelli_norm(normal) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "the normal is zero");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_SYMMETRY, edges, count, id, &condition);
    if (status) return status;
    condition->vector = dgfem_shelli_unit(normal);
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_clamp(dgfem_shell *shell, const int *edges, int count, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_CLAMP, edges, count, id, &condition);
    if (!status) dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_fix_rotation(dgfem_shell *shell, const int *edges, int count, dgfem_real angle,
                                                int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 1);
    if (!status) status = dgfem_shelli_check_real(shell, angle, "angle");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_ROTATION, edges, count, id, &condition);
    if (status) return status;
    condition->scalar = angle;
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_move_fixture(dgfem_shell *shell, int id, dgfem_vec3 displacement) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FIX, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, displacement, "displacement");
    if (!status) condition->vector = displacement;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_move_clamp(dgfem_shell *shell, int id, dgfem_mat3 rotation, dgfem_vec3 translation) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_CLAMP, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, translation, "translation");
    if (status) return status;
    dgfem_mat3 transposed = dgfem_shelli_transposed(&rotation), unit = dgfem_shelli_multiply3(&transposed, &rotation);
    dgfem_real error = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) error += dgfem_shelli_abs(unit.m[i][j] - (dgfem_real)(i == j));
    if (!(error < DGFEM_R(1e-4)))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d: not a rotation", id);
    if (!(dgfem_shelli_determinant(&rotation) > 0))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d: a reflection, not a rotation", id);
    condition->rotation = rotation;
    condition->vector = translation;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_turn_edges(dgfem_shell *shell, int id, dgfem_real angle) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_ROTATION, 0, &condition);
    if (!status) status = dgfem_shelli_check_real(shell, angle, "angle");
    if (!status) condition->scalar = angle;
    return status;
}

/* ---- what loads ---- */

DGFEM_API dgfem_status dgfem_shell_set_moment(dgfem_shell *shell, const int *edges, int count, dgfem_real moment,
                                              int follower, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_boundary(shell, edges, count, 0);
    if (!status) status = dgfem_shelli_check_real(shell, moment, "moment");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_MOMENT, edges, count, id, &condition);
    if (status) return status;
    condition->scalar = moment;
    condition->follower = follower != 0;
    dgfem_shelli_mark_edges(shell, shell->condition_count - 1);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_line_load(dgfem_shell *shell, const int *edges, int count, dgfem_vec3 load,
                                                 int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    if (!status) status = dgfem_shelli_check_vector(shell, load, "load");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_LINE_LOAD, edges, count, id, &condition);
    if (!status) condition->vector = load;
    return status;
}

/* Appends a pressure; without a list of elements, on all. */
static dgfem_status dgfem_shelli_add_pressure(dgfem_shell *shell, const int *elements, int count, int *id,
                                              dgfem_shell_condition **condition) {
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    dgfem_status status = DGFEM_OK;
    if (!elements) {
        int *all = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
        for (int e = 0; all && e < shell->element_count; e++) all[e] = e;
        elements = all;
        count = shell->element_count;
        if (!all) status = dgfem_shelli_fail_memory(&shell->hooks);
    }
    if (!status) status = dgfem_shelli_check_items(shell, elements, count, shell->element_count, "element");
    if (!status)
        status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_PRESSURE, elements, count, id, condition);
    dgfem_shelli_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_set_pressure(dgfem_shell *shell, const int *elements, int count, dgfem_real pressure,
                                                int follower, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_real(shell, pressure, "pressure");
    if (!status) status = dgfem_shelli_add_pressure(shell, elements, count, id, &condition);
    if (status) return status;
    condition->scalar = pressure;
    condition->follower = follower != 0;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_add_force(dgfem_shell *shell, const int *nodes, int count, dgfem_vec3 force,
                                             int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, nodes, count, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_vector(shell, force, "force");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_FORCE, nodes, count, id, &condition);
    if (!status) condition->vector = force;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_pin(dgfem_shell *shell, int node, dgfem_real stiffness, int *id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, &node, 1, shell->node_count, "node");
    if (!status) status = dgfem_shelli_check_scalar(&shell->hooks, stiffness, 0, "stiffness");
    if (!status) status = dgfem_shelli_add_condition(shell, DGFEM_SHELL_CONDITION_PIN, &node, 1, id, &condition);
    if (status) return status;
    condition->scalar = stiffness;
    condition->vector = condition->vector_before = shell->position[node];
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_drag(dgfem_shell *shell, int id, dgfem_vec3 place) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_PIN, 0, &condition);
    if (!status) status = dgfem_shelli_check_vector(shell, place, "place");
    if (!status) condition->vector = place;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_change_load(dgfem_shell *shell, int id, dgfem_vec3 vector, dgfem_real scalar) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FORCE, 1, &condition);
    if (!status && condition->kind != DGFEM_SHELL_CONDITION_FORCE && condition->kind != DGFEM_SHELL_CONDITION_MOMENT &&
        condition->kind != DGFEM_SHELL_CONDITION_LINE_LOAD && condition->kind != DGFEM_SHELL_CONDITION_PRESSURE)
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is not a load", id);
    if (!status) status = dgfem_shelli_check_vector(shell, vector, "load");
    if (!status) status = dgfem_shelli_check_real(shell, scalar, "load");
    if (status) return status;
    condition->vector = vector;
    condition->scalar = scalar;
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_gravity(dgfem_shell *shell, dgfem_vec3 gravity) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_vector(shell, gravity, "gravity");
    if (!status) shell->desc.gravity = gravity;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_remove_condition(dgfem_shell *shell, int id) {
    dgfem_shell_condition *condition;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_get_condition(shell, id, DGFEM_SHELL_CONDITION_FIX, 1, &condition);
    if (status) return status;
    dgfem_shelli_free(&shell->hooks, condition->items);
    shell->condition_count--;
    memmove(condition, condition + 1,
            (size_t)(shell->conditions + shell->condition_count - condition) * sizeof *condition);
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfem_shelli_check_shape(const dgfem_shell *shell, dgfem_shape_kind kind,
                                             const dgfem_shape_desc *desc) {
    const dgfem_hooks *hooks = &shell->hooks;
    if (!desc || desc->cookie != dgfem_default_shape_desc().cookie) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_scalar(hooks, desc->stiffness, 0, "stiffness");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->damping, 0, "damping");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->friction, 0, "friction");
    if (!status) status = dgfem_shelli_check_scalar(hooks, desc->slip_speed, 1, "slip_speed");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->velocity, "velocity");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->centre, "centre");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->plane.normal, "normal");
    if (!status) status = dgfem_shelli_check_real(shell, desc->plane.offset, "offset");
    if (!status) status = dgfem_shelli_check_real(shell, desc->radius, "radius");
    if (!status && kind == DGFEM_SHAPE_PLANE && !(dgfem_shelli_norm(desc->plane.normal) > 0))
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "the plane's normal is zero");
    if (!status && kind == DGFEM_SHAPE_SPHERE && desc->radius == 0)
        status = dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "the sphere's radius is 0");
    return status;
}

static dgfem_status dgfem_shelli_add_shape(dgfem_shell *shell, dgfem_shape_kind kind, const dgfem_shape_desc *desc,
                                           int *id) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_shape(shell, kind, desc);
    if (status) return status;
    if (shell->shape_count == shell->shape_capacity) {
        int capacity = 2 * shell->shape_capacity + 4;
        dgfem_shape *grown =
            (dgfem_shape *)dgfem_shelli_reallocate(&shell->hooks, shell->shapes, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_shelli_fail_memory(&shell->hooks);
        shell->shapes = grown;
        shell->shape_capacity = capacity;
    }
    dgfem_shape *shape = &shell->shapes[shell->shape_count++];
    memset(shape, 0, sizeof *shape);
    shape->id = shell->next_id++;
    shape->kind = kind;
    shape->desc = *desc;
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_add_plane(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id) {
    return dgfem_shelli_add_shape(shell, DGFEM_SHAPE_PLANE, desc, id);
}

DGFEM_API dgfem_status dgfem_shell_add_sphere(dgfem_shell *shell, const dgfem_shape_desc *desc, int *id) {
    return dgfem_shelli_add_shape(shell, DGFEM_SHAPE_SPHERE, desc, id);
}

/* Position of the shape of this id in the list, or DGFEM_NONE; that has its line in the log. */
static int dgfem_shelli_find_shape(const dgfem_shell *shell, int id) {
    for (int s = 0; s < shell->shape_count; s++)
        if (shell->shapes[s].id == id) return s;
    (void)dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "no shape has the id %d", id);
    return DGFEM_NONE;
}

DGFEM_API dgfem_status dgfem_shell_move_shape(dgfem_shell *shell, int id, const dgfem_shape_desc *desc) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    int s = dgfem_shelli_find_shape(shell, id);
    if (s == DGFEM_NONE) return DGFEM_ERROR_INDEX;
    dgfem_status status = dgfem_shelli_check_shape(shell, shell->shapes[s].kind, desc);
    if (!status) shell->shapes[s].desc = *desc;
    return status;
}

DGFEM_API dgfem_status dgfem_shell_remove_shape(dgfem_shell *shell, int id) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    int s = dgfem_shelli_find_shape(shell, id);
    if (s == DGFEM_NONE) return DGFEM_ERROR_INDEX;
    memmove(shell->shapes + s, shell->shapes + s + 1, (size_t)(--shell->shape_count - s) * sizeof *shell->shapes);
    return DGFEM_OK;
}

/* ==== load.c ====================================================================================================== */

/* External forces, their derivatives, and the directions in which nodes are held. */

/* ---- forces ---- */

/* Whether a load turns with the shell: without rotations to follow there is only rest to act on. */
static int dgfem_shelli_follows(const dgfem_shell *shell, const dgfem_shell_condition *condition) {
    return condition->follower && shell->desc.corotational;
}

/* What pressure p at a point does: p n dA on its nodes, n dA that of rest or of now. */
static dgfem_vec3 dgfem_shelli_pressure(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                        const dgfem_shelli_point *point, const dgfem_shelli_local *local, int q,
                                        int follower, dgfem_vec3 *e1, dgfem_vec3 *e2) {
    int nodes = shell->elements[group->owner].node_count;
    dgfem_real weight;
    if (!follower) return dgfem_shelli_scale(point->weight, point->t);
    (void)dgfem_shelli_quadrature(nodes, q, &weight);
    dgfem_shelli_side_bases(group, &shell->system->basis[point->basis[0]], 0, nodes, local, e1, e2);
    *e1 = dgfem_shelli_scale(weight, *e1);
    return dgfem_shelli_cross(*e1, *e2);
}

/* Groups of elements come first, in the order of the elements. */
static const dgfem_shelli_group *dgfem_shelli_element_group(const dgfem_shell *shell, int element) {
    return &shell->system->groups[element];
}

static void dgfem_shelli_add_pressure_force(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                            const dgfem_vec3 *x, dgfem_real factor, dgfem_vec3 *out) {
    dgfem_real pressure = factor * dgfem_shelli_scalar_now(shell, condition);
    int follower = dgfem_shelli_follows(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const dgfem_shelli_group *group = dgfem_shelli_element_group(shell, condition->items[i]);
        dgfem_shelli_local local;
        dgfem_vec3 e1, e2;
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            const dgfem_real *n = shell->system->basis[point->basis[0]].n;
            dgfem_vec3 push = dgfem_shelli_pressure(shell, group, point, &local, q, follower, &e1, &e2);
            for (int a = 0; a < local.count; a++)
                out[local.nodes[a]] = dgfem_shelli_axpy(out[local.nodes[a]], pressure * n[a], push);
        }
    }
}

/* Integrals over a line of N of its start, end and middle are in the ratio of Simpson's weights on straight edges; on
   curved ones three Gauss points give them. */
static void dgfem_shelli_add_line_load(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                       dgfem_real factor, dgfem_vec3 *out) {
    dgfem_vec3 load = dgfem_shelli_vector_now(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const int *node = shell->edges[condition->items[i]].node;
        for (int q = 0; q < DGFEM_SHELLI_EDGE_POINTS; q++) {
            dgfem_real s = dgfem_shelli_gauss_point(q);
            dgfem_real n[3], d[3];
            n[0] = s * (s - 1) / 2, n[1] = s * (s + 1) / 2, n[2] = 1 - s * s;
            d[0] = s - DGFEM_R(0.5), d[1] = s + DGFEM_R(0.5), d[2] = -2 * s;
            dgfem_vec3 tangent = dgfem_shelli_scale(d[0], shell->rest[node[0]]);
            tangent = dgfem_shelli_axpy(tangent, d[1], shell->rest[node[1]]);
            tangent = dgfem_shelli_axpy(tangent, d[2], shell->rest[node[2]]);
            dgfem_real length = factor * dgfem_shelli_gauss_weight(q) * dgfem_shelli_norm(tangent);
            for (int a = 0; a < 3; a++) out[node[a]] = dgfem_shelli_axpy(out[node[a]], length * n[a], load);
        }
    }
}

/* The forces p_a (rotated frame) that balance the moments of a boundary point: J is minus the tilt. */
static void dgfem_shelli_moment_forces(const dgfem_shell *shell, const dgfem_shelli_point *point, dgfem_real moment,
                                       int count, dgfem_vec3 *force) {
    dgfem_real stress = moment * point->weight;
    dgfem_shelli_point_forces(shell->system->strains + point->strain_start, 1, &stress, count, force);
}

/* The rotation of a boundary point for follower moments: its own, whatever holds the edge. */
static void dgfem_shelli_moment_rotation(const dgfem_shell *shell, const dgfem_shelli_group *group,
                                         const dgfem_shelli_point *point, const dgfem_shelli_local *local, int spins,
                                         dgfem_shelli_kinematics *k) {
    k->r = dgfem_shelli_identity();
    if (shell->desc.corotational) dgfem_shelli_rotate(shell, group, point, local, spins, k);
}

static void dgfem_shelli_add_moments(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor,
                                     dgfem_vec3 *out) {
    for (int g = shell->element_count; g < shell->system->group_count; g++) {
        const dgfem_shelli_group *group = &shell->system->groups[g];
        const dgfem_shell_edge *edge = &shell->edges[group->owner];
        if (edge->moment == 0 && edge->follower_moment == 0) continue;
        dgfem_shelli_local local;
        dgfem_shelli_kinematics k;
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            dgfem_shelli_moment_rotation(shell, group, point, &local, 0, &k);
            dgfem_shelli_moment_forces(shell, point, 1, local.count, k.force);
            for (int a = 0; a < local.count; a++) {
                dgfem_vec3 turned = dgfem_shelli_multiply(&k.r, k.force[a]), *to = &out[local.nodes[a]];
                *to = dgfem_shelli_axpy(*to, -factor * edge->moment, k.force[a]);
                *to = dgfem_shelli_axpy(*to, -factor * edge->follower_moment, turned);
            }
        }
    }
}

/* out += factor * external forces at positions x. In motion (`lumped`) gravity pulls at the lumped masses, so that
   free fall is uniform; at rest it is a load like any other. */
static void dgfem_shelli_add_external(const dgfem_shell *shell, const dgfem_vec3 *x, int lumped, dgfem_real factor,
                                      dgfem_vec3 *out) {
    const dgfem_real *weight = lumped ? shell->node_mass : shell->node_load;
    dgfem_vec3 gravity = dgfem_shelli_between(shell, shell->gravity_before, shell->desc.gravity);
    for (int i = 0; i < shell->node_count; i++) out[i] = dgfem_shelli_axpy(out[i], factor * weight[i], gravity);
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        if (condition->kind == DGFEM_SHELL_CONDITION_PRESSURE)
            dgfem_shelli_add_pressure_force(shell, condition, x, factor, out);
        if (condition->kind == DGFEM_SHELL_CONDITION_LINE_LOAD)
            dgfem_shelli_add_line_load(shell, condition, factor, out);
        int pin = condition->kind == DGFEM_SHELL_CONDITION_PIN;
        if (!pin && condition->kind != DGFEM_SHELL_CONDITION_FORCE) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_vec3 *to = &out[condition->items[i]], force = dgfem_shelli_vector_now(shell, condition);
            if (pin) force = dgfem_shelli_scale(condition->scalar, dgfem_shelli_sub(force, x[condition->items[i]]));
            *to = dgfem_shelli_axpy(*to, factor, force);
        }
    }
    dgfem_shelli_add_moments(shell, x, factor, out);
}

/* out += factor * those loads that turn with the shell. */
static void dgfem_shelli_add_followers(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor,
                                       dgfem_vec3 *out) {
    for (int c = 0; c < shell->condition_count; c++)
        if (shell->conditions[c].kind == DGFEM_SHELL_CONDITION_PRESSURE &&
            dgfem_shelli_follows(shell, &shell->conditions[c]))
            dgfem_shelli_add_pressure_force(shell, &shell->conditions[c], x, factor, out);
    dgfem_shelli_add_moments(shell, x, factor, out);
}

/* ---- derivatives ---- */

/* Minus the derivative of a follower pressure, symmetric part: on interior nodes all of it. */
static void dgfem_shelli_assemble_pressure(const dgfem_shell *shell, const dgfem_shell_condition *condition,
                                           const dgfem_vec3 *x, dgfem_real factor) {
    dgfem_real pressure = dgfem_shelli_scalar_now(shell, condition);
    for (int i = 0; i < condition->count; i++) {
        const dgfem_shelli_group *group = dgfem_shelli_element_group(shell, condition->items[i]);
        dgfem_real dense[9 * DGFEM_SHELL_MAX_NODES * DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_local local;
        dgfem_vec3 e1, e2;
        int n = group->node_count, width = 3 * n;
        memset(dense, 0, sizeof dense);
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            const dgfem_shelli_basis *f = &shell->system->basis[point->basis[0]];
            dgfem_real weight;
            (void)dgfem_shelli_pressure(shell, group, point, &local, q, 1, &e1, &e2);
            (void)dgfem_shelli_quadrature(n, q, &weight);
            for (int a = 0; a < n; a++)
                for (int b = 0; b < n; b++) { /* d(e1 x e2) = [e1]x d2 - [e2]x d1 */
                    dgfem_vec3 v = dgfem_shelli_scale(f->d2[b], e1);
                    v = dgfem_shelli_axpy(v, -weight * f->d1[b], e2);
                    dgfem_mat3 m = dgfem_shelli_cross_matrix(dgfem_shelli_scale(-pressure * f->n[a], v));
                    for (int k = 0; k < 9; k++) dense[(3 * a + k / 3) * width + 3 * b + k % 3] += m.m[k / 3][k % 3];
                }
        }
        dgfem_shelli_scatter(shell->system, group, factor, dense);
    }
}

static void dgfem_shelli_assemble_moments(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real factor) {
    for (int g = shell->element_count; g < shell->system->group_count; g++) {
        const dgfem_shelli_group *group = &shell->system->groups[g];
        const dgfem_shell_edge *edge = &shell->edges[group->owner];
        dgfem_real dense[9 * DGFEM_SHELL_MAX_NODES * DGFEM_SHELL_MAX_NODES];
        dgfem_shelli_local local;
        dgfem_shelli_kinematics k;
        if (edge->follower_moment == 0 || !shell->desc.corotational) continue;
        memset(dense, 0, sizeof dense);
        dgfem_shelli_local_take(shell, group, x, &local);
        for (int q = 0; q < group->point_count; q++) {
            const dgfem_shelli_point *point = &shell->system->points[group->point_start + q];
            dgfem_shelli_moment_rotation(shell, group, point, &local, 1, &k);
            dgfem_shelli_moment_forces(shell, point, edge->follower_moment, local.count, k.force);
            for (int a = 0; a < local.count; a++) {
                dgfem_mat3 p = dgfem_shelli_cross_matrix(dgfem_shelli_scale(-1, k.force[a]));
                p = dgfem_shelli_multiply3(&k.r, &p);
                for (int b = 0; b < local.count; b++) {
                    dgfem_mat3 m = dgfem_shelli_multiply3(&p, &k.spin[b]);
                    for (int i = 0; i < 9; i++)
                        dense[(3 * a + i / 3) * 3 * local.count + 3 * b + i % 3] += m.m[i / 3][i % 3];
                }
            }
        }
        dgfem_shelli_scatter(shell->system, group, factor, dense);
    }
}

/* matrix += factor * minus the derivative of the external forces (its symmetric part); with `followers` 0 of pins
   only, which keeps the matrix positive definite. */
static void dgfem_shelli_assemble_external(const dgfem_shell *shell, const dgfem_vec3 *x, int followers,
                                           dgfem_real factor) {
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        int follows = followers && dgfem_shelli_follows(shell, condition);
        if (condition->kind == DGFEM_SHELL_CONDITION_PRESSURE && follows)
            dgfem_shelli_assemble_pressure(shell, condition, x, factor);
        if (condition->kind != DGFEM_SHELL_CONDITION_PIN) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_real *block = shell->system->matrix->values + shell->system->diagonal[condition->items[i]];
            for (int k = 0; k < 9; k += 4) block[k] += factor * condition->scalar;
        }
    }
    if (followers) dgfem_shelli_assemble_moments(shell, x, factor);
}

/* ---- held directions ---- */

/* Holds the displacement of a node along a unit direction. Directions that others hold already have no effect. */
static void dgfem_shelli_hold(dgfem_shell_system *system, int node, dgfem_vec3 direction, dgfem_real value) {
    dgfem_mat3 *free_part = &system->free_part[node];
    dgfem_vec3 rest = dgfem_shelli_multiply(free_part, direction);
    dgfem_real length = dgfem_shelli_norm(rest);
    if (!(length > DGFEM_R(1e-3))) return;
    rest = dgfem_shelli_scale(1 / length, rest);
    value = (value - dgfem_shelli_dot(system->target[node], direction)) / dgfem_shelli_dot(rest, direction);
    system->target[node] = dgfem_shelli_axpy(system->target[node], value, rest);
    dgfem_shelli_add_outer(free_part, -1, rest, rest);
    system->held[node] = 1;
}

static void dgfem_shelli_hold_axes(dgfem_shell_system *system, int node, int axes, dgfem_vec3 displacement) {
    if (axes & DGFEM_SHELL_X) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(1, 0, 0), displacement.x);
    if (axes & DGFEM_SHELL_Y) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(0, 1, 0), displacement.y);
    if (axes & DGFEM_SHELL_Z) dgfem_shelli_hold(system, node, dgfem_shelli_vec3(0, 0, 1), displacement.z);
}

/* Displacement that a condition gives to a node now, if it was where the condition had it `before`; otherwise the
   difference vanishes along the path. */
static dgfem_vec3 dgfem_shelli_held_now(const dgfem_shell *shell, int node, dgfem_vec3 before, dgfem_vec3 now) {
    if (shell->system->part == 1) return now;
    dgfem_vec3 astray = dgfem_shelli_sub(dgfem_shelli_sub(shell->position[node], shell->rest[node]), before);
    return dgfem_shelli_axpy(now, 1 - shell->system->part, astray);
}

static void dgfem_shelli_hold_edge(const dgfem_shell *shell, const dgfem_shell_condition *condition, int edge) {
    int clamp = condition->kind == DGFEM_SHELL_CONDITION_CLAMP;
    dgfem_shelli_placement before = dgfem_shelli_clamp_before(condition), now = before;
    if (clamp) now = dgfem_shelli_clamp_now(shell, condition);
    for (int a = 0; a < 3; a++) {
        int node = shell->edges[edge].node[a];
        dgfem_vec3 x = shell->rest[node], from = dgfem_shelli_vec3(0, 0, 0), to = from;
        if (clamp) {
            from = dgfem_shelli_sub(dgfem_shelli_place(&before, x), x);
            to = dgfem_shelli_sub(dgfem_shelli_place(&now, x), x);
        }
        to = dgfem_shelli_held_now(shell, node, from, to);
        if (clamp) dgfem_shelli_hold_axes(shell->system, node, DGFEM_SHELL_XYZ, to);
        else dgfem_shelli_hold(shell->system, node, condition->vector, dgfem_shelli_dot(condition->vector, to));
    }
}

/* Collects what all conditions hold, at the present part of the path. Returns the number of conditions that hold
   anything. */
static int dgfem_shelli_collect_held(const dgfem_shell *shell) {
    dgfem_shell_system *system = shell->system;
    int holding = 0;
    for (int i = 0; i < shell->node_count; i++) {
        system->held[i] = 0;
        system->free_part[i] = dgfem_shelli_identity();
        system->target[i] = dgfem_shelli_vec3(0, 0, 0);
    }
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *condition = &shell->conditions[c];
        int clamp = condition->kind == DGFEM_SHELL_CONDITION_CLAMP;
        holding += clamp || condition->kind == DGFEM_SHELL_CONDITION_FIX ||
                   condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY || condition->kind == DGFEM_SHELL_CONDITION_PIN;
        for (int i = 0; i < condition->count; i++) {
            if (condition->kind == DGFEM_SHELL_CONDITION_FIX)
                dgfem_shelli_hold_axes(system, condition->items[i], condition->axes,
                                       dgfem_shelli_held_now(shell, condition->items[i], condition->vector_before,
                                                             dgfem_shelli_vector_now(shell, condition)));
            if (clamp || condition->kind == DGFEM_SHELL_CONDITION_SYMMETRY)
                dgfem_shelli_hold_edge(shell, condition, condition->items[i]);
        }
    }
    return holding;
}

/* Removes what is held from the matrix: blocks P_r A P_c, and (I - P) times the diagonal's size for the held part. */
static void dgfem_shelli_hold_matrix(const dgfem_shell *shell) {
    const dgfem_shell_system *system = shell->system;
    const dgfem_matrix *matrix = system->matrix;
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k];
            dgfem_real *block = matrix->values + matrix->value_start[k];
            if (!system->held[r] && !system->held[c]) continue;
            dgfem_mat3 m;
            memcpy(&m, block, sizeof m);
            dgfem_real size = (m.m[0][0] + m.m[1][1] + m.m[2][2]) / 3;
            m = dgfem_shelli_multiply3(&m, &system->free_part[c]);
            m = dgfem_shelli_multiply3(&system->free_part[r], &m);
            for (int i = 0; r == c && i < 9; i++)
                m.m[i / 3][i % 3] += dgfem_shelli_max(size, DGFEM_R(1e-30)) *
                                     ((dgfem_real)(i % 4 == 0) - system->free_part[r].m[i / 3][i % 3]);
            memcpy(block, &m, sizeof m);
        }
}

/* v = P v at held nodes. */
static void dgfem_shelli_hold_vector(const dgfem_shell *shell, dgfem_vec3 *v) {
    for (int i = 0; i < shell->node_count; i++)
        if (shell->system->held[i]) v[i] = dgfem_shelli_multiply(&shell->system->free_part[i], v[i]);
}

/* ==== static.c ==================================================================================================== */

/* Static equilibrium by Newton's method or frozen rotations, in load steps.

   A solve follows a path s = 0 .. 1 on which loads go from what they were at the end of the last solve or step to what
   they are now, fixed nodes straight from where they are to their targets, clamps by a screw motion. The first linear
   systems of a part take the symmetric part of the tangent: what is left out is of second order in the strains. Later
   ones, where that is what is left to converge, take all of it, by a few GMRES iterations with the factored part. */

DGFEM_API dgfem_shell_static_desc dgfem_default_shell_static_desc(void) {
    dgfem_shell_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.load_steps = 1;
    desc.max_halvings = 6;
    desc.max_iterations = 40;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-8);
    desc.line_search = 1;
    desc.relaxation = DGFEM_R(0.5);
    return desc;
}

static dgfem_shell_info dgfem_shelli_empty_info(void) {
    dgfem_shell_info info;
    memset(&info, 0, sizeof info);
    info.failed_node = DGFEM_NONE;
    return info;
}

static dgfem_real dgfem_shelli_product(const dgfem_shell *shell, const dgfem_vec3 *a, const dgfem_vec3 *b) {
    dgfem_real sum = 0;
    for (int i = 0; i < shell->node_count; i++) sum += dgfem_shelli_dot(a[i], b[i]);
    return sum;
}

static dgfem_real dgfem_shelli_length(const dgfem_shell *shell, const dgfem_vec3 *a) {
    return dgfem_shelli_sqrt(dgfem_shelli_product(shell, a, a));
}

static size_t dgfem_shelli_bytes(const dgfem_shell *shell) { return (size_t)shell->node_count * sizeof(dgfem_vec3); }

/* ---- the linear system ---- */

/* Size of the diagonal blocks: what a shift is measured by. */
static dgfem_real dgfem_shelli_shift_diagonal(const dgfem_shell *shell, dgfem_real part) {
    dgfem_real *values = shell->system->matrix->values, largest = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_real *block = values + shell->system->diagonal[i];
        dgfem_real size = (block[0] + block[4] + block[8]) / 3;
        largest = dgfem_shelli_max(largest, size);
        for (int k = 0; k < 9; k += 4) block[k] += part * size;
    }
    return largest;
}

static dgfem_status dgfem_shelli_factor(dgfem_shell *shell, dgfem_shell_info *info) {
    dgfem_cholesky_info factor;
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_status status = dgfem_cholesky_factor(shell->system->cholesky, shell->system->matrix, &factor);
    info->failed_node = factor.failed_block;
    info->seconds_factor += dgfem_shelli_clock(&shell->hooks) - start;
    return status;
}

/* Factors, with a growing part of the diagonal added where the matrix is not positive definite: the step then still
   goes downhill. */
static dgfem_status dgfem_shelli_factor_shifted(dgfem_shell *shell, dgfem_shell_info *info) {
    dgfem_real part = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-5) : DGFEM_R(1e-8);
    dgfem_status status = dgfem_shelli_factor(shell, info);
    for (int k = 0; k < 8 && status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE; k++, part *= 8) {
        (void)dgfem_shelli_shift_diagonal(shell, part);
        info->shifts++;
        status = dgfem_shelli_factor(shell, info);
    }
    return status;
}

static dgfem_status dgfem_shelli_solve(dgfem_shell *shell, const dgfem_vec3 *rhs, dgfem_vec3 *x,
                                       dgfem_shell_info *info) {
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_status status =
        dgfem_cholesky_solve(shell->system->cholesky, dgfem_shelli_reals(rhs), dgfem_shelli_reals_of(x));
    info->seconds_solve += dgfem_shelli_clock(&shell->hooks) - start;
    for (int i = 0; !status && i < shell->node_count; i++)
        if (!dgfem_shelli_is_finite3(x[i])) status = DGFEM_ERROR_NOT_FINITE;
    return status;
}

/* ---- residual ---- */

/* How a solve stands. */
typedef struct dgfem_shelli_path {
    dgfem_real scale;     /* size of the forces that balance */
    dgfem_real stiffness; /* largest diagonal, for the round-off of forces */
    dgfem_real extent;    /* of the shell */
    dgfem_real reach;     /* what the round-off of positions is measured by */
    int search;           /* whether to search along the lines */
} dgfem_shelli_path;

/* r = F_ext - f_int at x, without the reactions of what is held; also sets the scale. */
static void dgfem_shelli_residual(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_shelli_path *path,
                                  dgfem_vec3 *r) {
    dgfem_vec3 *force = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    memset(force, 0, dgfem_shelli_bytes(shell));
    memset(r, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, x, 0, 1, force);
    (void)dgfem_shelli_add_internal(shell, x, 0, 1, r);
    path->scale = dgfem_shelli_max(dgfem_shelli_length(shell, force), dgfem_shelli_length(shell, r));
    for (int i = 0; i < shell->node_count; i++) r[i] = dgfem_shelli_sub(force[i], r[i]);
    dgfem_shelli_hold_vector(shell, r);
}

/* Converged, by tolerance or because round-off allows no more. */
static int dgfem_shelli_converged(const dgfem_shelli_path *path, dgfem_real tolerance, dgfem_real residual) {
    dgfem_real floor = 4 * DGFEM_SHELL_EPSILON * path->stiffness * path->reach;
    return residual <= tolerance * path->scale || residual <= floor;
}

static dgfem_real dgfem_shelli_extent(const dgfem_shell *shell) {
    dgfem_real square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_vec3 d = dgfem_shelli_sub(shell->rest[i], shell->rest[0]);
        square = dgfem_shelli_max(square, dgfem_shelli_dot(d, d));
    }
    return dgfem_shelli_sqrt(square);
}

/* Size of the numbers that positions x and those of rest are made of: the extent and the distance from the origin. */
static dgfem_real dgfem_shelli_reach(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real extent) {
    dgfem_real square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        square = dgfem_shelli_max(square, dgfem_shelli_dot(x[i], x[i]));
        square = dgfem_shelli_max(square, dgfem_shelli_dot(shell->rest[i], shell->rest[i]));
    }
    return extent + dgfem_shelli_sqrt(square);
}

/* ---- one Newton iteration ---- */

/* The prescribed part of the next increment: what held directions lack. Returns its size. */
static dgfem_real dgfem_shelli_prescribed(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_vec3 *motion) {
    const dgfem_shell_system *system = shell->system;
    dgfem_real size = 0;
    for (int i = 0; i < shell->node_count; i++) {
        motion[i] = dgfem_shelli_vec3(0, 0, 0);
        if (!system->held[i]) continue;
        dgfem_vec3 lack = dgfem_shelli_sub(system->target[i], dgfem_shelli_sub(x[i], shell->rest[i]));
        motion[i] = dgfem_shelli_sub(lack, dgfem_shelli_multiply(&system->free_part[i], lack));
        size = dgfem_shelli_max(size, dgfem_shelli_norm(motion[i]));
    }
    return size;
}

/* Whether a load's derivative is not all in the symmetric matrix. */
static int dgfem_shelli_has_followers(const dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++)
        if (dgfem_shelli_follows(shell, &shell->conditions[c])) return 1;
    return 0;
}

/* out = P (K_tangent v - dF_ext v), all of it; the loads by a difference. */
static void dgfem_shelli_full_product(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                      dgfem_real extent, dgfem_vec3 *out) {
    dgfem_vec3 *ahead = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_tangent_product(shell, x, v, out);
    for (int c = 0; c < shell->condition_count; c++) {
        const dgfem_shell_condition *pin = &shell->conditions[c];
        if (pin->kind != DGFEM_SHELL_CONDITION_PIN) continue;
        for (int i = 0; i < pin->count; i++)
            out[pin->items[i]] = dgfem_shelli_axpy(out[pin->items[i]], pin->scalar, v[pin->items[i]]);
    }
    dgfem_real length = dgfem_shelli_length(shell, v);
    if (dgfem_shelli_has_followers(shell) && length > 0) {
        dgfem_real step = dgfem_shelli_sqrt(DGFEM_SHELL_EPSILON) * extent / length;
        for (int sign = -1; sign <= 1; sign += 2) {
            for (int i = 0; i < shell->node_count; i++)
                ahead[i] = dgfem_shelli_axpy(x[i], (dgfem_real)sign * step, v[i]);
            dgfem_shelli_add_followers(shell, ahead, (dgfem_real)-sign / (2 * step), out);
        }
    }
    dgfem_shelli_hold_vector(shell, out);
}

/* Improves y = K_sym^-1 b to the solution of K y = b by GMRES, K_sym being factored: y += sum c_k v_k with the smallest
   residual K_sym^-1 (b - K y). */
static dgfem_status dgfem_shelli_refine(dgfem_shell *shell, const dgfem_vec3 *x, dgfem_real extent, const dgfem_vec3 *b,
                                        dgfem_vec3 *y, dgfem_shell_info *info) {
    enum { STEPS = DGFEM_SHELLI_VECTORS - DGFEM_SHELLI_KRYLOV - 1 };
    dgfem_real h[STEPS + 1][STEPS], cosine[STEPS], sine[STEPS], g[STEPS + 1];
    dgfem_vec3 *work = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    dgfem_vec3 *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_KRYLOV);
    const dgfem_real enough = DGFEM_R(1e-6) * dgfem_shelli_length(shell, y);
    int n = shell->node_count, steps = 0;
    dgfem_shelli_full_product(shell, x, y, extent, work);
    for (int i = 0; i < n; i++) work[i] = dgfem_shelli_sub(b[i], work[i]);
    dgfem_status status = dgfem_shelli_solve(shell, work, v, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, v);
    g[0] = dgfem_shelli_length(shell, v);
    for (int i = 0; g[0] > 0 && i < n; i++) v[i] = dgfem_shelli_scale(1 / g[0], v[i]);
    while (steps < STEPS && dgfem_shelli_abs(g[steps]) > enough) {
        const int k = steps++;
        dgfem_vec3 *next = v + (size_t)(k + 1) * (size_t)n;
        dgfem_shelli_full_product(shell, x, v + (size_t)k * (size_t)n, extent, work);
        status = dgfem_shelli_solve(shell, work, next, info);
        if (status) return status;
        dgfem_shelli_hold_vector(shell, next);
        for (int j = 0; j <= k; j++) {
            const dgfem_vec3 *old = v + (size_t)j * (size_t)n;
            h[j][k] = dgfem_shelli_product(shell, old, next);
            for (int i = 0; i < n; i++) next[i] = dgfem_shelli_axpy(next[i], -h[j][k], old[i]);
        }
        h[k + 1][k] = dgfem_shelli_length(shell, next);
        for (int i = 0; h[k + 1][k] > 0 && i < n; i++) next[i] = dgfem_shelli_scale(1 / h[k + 1][k], next[i]);
        for (int j = 0; j < k; j++) {
            dgfem_real upper = h[j][k];
            h[j][k] = cosine[j] * upper + sine[j] * h[j + 1][k];
            h[j + 1][k] = cosine[j] * h[j + 1][k] - sine[j] * upper;
        }
        dgfem_real length = dgfem_shelli_sqrt(h[k][k] * h[k][k] + h[k + 1][k] * h[k + 1][k]);
        if (!(length > 0)) break;
        cosine[k] = h[k][k] / length, sine[k] = h[k + 1][k] / length;
        h[k][k] = length;
        g[k + 1] = -sine[k] * g[k], g[k] *= cosine[k];
    }
    for (int k = steps - 1; k >= 0; k--) { /* g becomes the coefficients */
        for (int j = k + 1; j < steps; j++) g[k] -= h[k][j] * g[j];
        if (!(dgfem_shelli_abs(h[k][k]) > 0)) return DGFEM_OK;
        g[k] /= h[k][k];
    }
    for (int k = 0; k < steps; k++)
        for (int i = 0; i < n; i++) y[i] = dgfem_shelli_axpy(y[i], g[k], v[(size_t)k * (size_t)n + (size_t)i]);
    return DGFEM_OK;
}

/* Solves for the increment at x: SOLUTION = MOTION + P K^-1 P (r - K MOTION). */
static dgfem_status dgfem_shelli_increment(dgfem_shell *shell, const dgfem_vec3 *x, int frozen, dgfem_shelli_path *path,
                                           int moves, int refine, dgfem_shell_info *info) {
    int shifts = info->shifts;
    const dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *motion = dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION);
    dgfem_vec3 *rhs = dgfem_shelli_vector(shell, DGFEM_SHELLI_RHS);
    dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, x, !frozen && shell->desc.corotational, 1, 1);
    dgfem_shelli_assemble_external(shell, x, !frozen, 1);
    path->stiffness = dgfem_shelli_shift_diagonal(shell, 0);
    memset(rhs, 0, dgfem_shelli_bytes(shell));
    if (moves) dgfem_matrix_multiply(shell->system->matrix, dgfem_shelli_reals(motion), dgfem_shelli_reals_of(rhs));
    for (int i = 0; i < shell->node_count; i++) rhs[i] = dgfem_shelli_sub(r[i], rhs[i]);
    dgfem_shelli_hold_vector(shell, rhs);
    dgfem_shelli_hold_matrix(shell);
    info->seconds_assemble += dgfem_shelli_clock(&shell->hooks) - start;
    dgfem_status status =
        shell->desc.corotational ? dgfem_shelli_factor_shifted(shell, info) : dgfem_shelli_factor(shell, info);
    if (!status) status = dgfem_shelli_solve(shell, rhs, solution, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, solution);
    if (refine && !moves && info->shifts == shifts)
        status = dgfem_shelli_refine(shell, x, path->extent, rhs, solution, info);
    for (int i = 0; i < shell->node_count; i++) solution[i] = dgfem_shelli_add(solution[i], motion[i]);
    return status;
}

/* to = from + factor * SOLUTION */
static void dgfem_shelli_move(const dgfem_shell *shell, const dgfem_vec3 *from, dgfem_real factor, dgfem_vec3 *to) {
    const dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    for (int i = 0; i < shell->node_count; i++) to[i] = dgfem_shelli_axpy(from[i], factor, solution[i]);
}

/* Line search for a zero of the work g(s) = SOLUTION . r(x + s SOLUTION), by false position: a full step where that has
   fallen below `enough` of g(0). Leaves BEST and its residual. Full steps of a bending shell overshoot by far, for they
   stretch it, and yet converge faster: this is for where they do not converge. */
static void dgfem_shelli_search(const dgfem_shell *shell, const dgfem_vec3 *x, dgfem_shelli_path *path) {
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *best = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    const dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    const dgfem_real enough = DGFEM_R(0.8);
    dgfem_real g0 = dgfem_shelli_product(shell, solution, r), low = 0, g_low = g0, high = 1;
    dgfem_shelli_move(shell, x, 1, best);
    dgfem_shelli_residual(shell, best, path, r);
    dgfem_real g_high = dgfem_shelli_product(shell, solution, r), s = 1;
    for (int k = 0; k < 6; k++) {
        dgfem_real g = s == high ? g_high : g_low;
        if (dgfem_shelli_abs(g) <= enough * dgfem_shelli_abs(g0) || !(g_low > 0) || (g_high > 0)) return;
        dgfem_real next = low + (high - low) * g_low / (g_low - g_high);
        if (!(next > low + DGFEM_R(0.1) * (high - low))) next = low + DGFEM_R(0.1) * (high - low);
        s = next;
        dgfem_shelli_move(shell, x, s, best);
        dgfem_shelli_residual(shell, best, path, r);
        g = dgfem_shelli_product(shell, solution, r);
        if (g < 0 || !dgfem_shelli_is_finite(g)) high = s, g_high = g;
        else low = s, g_low = g;
    }
}

/* Newton (or the fixed point) at one part of the path; x = X on entry and exit. */
static dgfem_status dgfem_shelli_iterate(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                         dgfem_shelli_path *path, dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *best = dgfem_shelli_vector(shell, DGFEM_SHELLI_BEST);
    for (int iteration = 0; iteration < desc->max_iterations; iteration++) {
        dgfem_real moved = dgfem_shelli_prescribed(shell, x, dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION));
        path->reach = dgfem_shelli_reach(shell, x, path->extent);
        int moves = moved > 10 * DGFEM_SHELL_EPSILON * path->reach;
        if (iteration == 0) dgfem_shelli_residual(shell, x, path, r);
        int refine = !desc->frozen && shell->desc.corotational && iteration >= 3;
        dgfem_status status = dgfem_shelli_increment(shell, x, desc->frozen, path, moves, refine, info);
        if (status) return status;
        info->iterations++;
        if (path->search && !moves && !desc->frozen && shell->desc.corotational) {
            dgfem_shelli_search(shell, x, path);
        } else {
            int whole = !desc->frozen || !shell->desc.corotational || iteration == 0;
            dgfem_shelli_move(shell, x, whole ? 1 : desc->relaxation, best);
            dgfem_shelli_residual(shell, best, path, r);
        }
        memcpy(x, best, dgfem_shelli_bytes(shell));
        dgfem_real residual = dgfem_shelli_length(shell, r);
        info->residual = path->scale > 0 ? residual / path->scale : 0;
        if (!dgfem_shelli_is_finite(residual)) return DGFEM_ERROR_NOT_CONVERGED;
        if (!shell->desc.corotational || dgfem_shelli_converged(path, desc->tolerance, residual)) return DGFEM_OK;
    }
    return DGFEM_ERROR_NOT_CONVERGED;
}

/* ---- load steps ---- */

/* Advances the path in steps, halving those that fail. */
static dgfem_status dgfem_shelli_follow_path(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                             dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *good = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_shelli_path path;
    dgfem_real done = 0, step = 1 / (dgfem_real)desc->load_steps, smallest = step;
    for (int k = 0; k < desc->max_halvings; k++) smallest /= 2;
    memset(&path, 0, sizeof path);
    path.extent = dgfem_shelli_extent(shell);
    path.search = desc->line_search >= 2;
    memcpy(x, shell->position, dgfem_shelli_bytes(shell));
    while (done < 1) {
        memcpy(good, x, dgfem_shelli_bytes(shell));
        dgfem_real part = done + step < 1 - DGFEM_R(1e-6) ? done + step : 1;
        info->load_steps++;
        shell->system->part = part;
        dgfem_shelli_refresh_edges(shell);
        (void)dgfem_shelli_collect_held(shell);
        dgfem_status status = dgfem_shelli_iterate(shell, desc, &path, info);
        if (!status) {
            done = part;
            continue;
        }
        if (status == DGFEM_ERROR_MEMORY || !shell->desc.corotational || step / 2 < smallest * DGFEM_R(0.99))
            return status;
        memcpy(x, good, dgfem_shelli_bytes(shell));
        step /= 2;
        path.search = desc->line_search >= 1;
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_check_static(const dgfem_shell *shell, const dgfem_shell_static_desc *desc) {
    const dgfem_hooks *hooks = &shell->hooks;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (desc->load_steps < 1 || desc->max_iterations < 1 || desc->max_halvings < 0 || desc->max_halvings > 30)
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d load steps, %d halvings, %d iterations",
                                 desc->load_steps, desc->max_halvings, desc->max_iterations);
    if (!(desc->relaxation > 0 && desc->relaxation <= 1))
        return dgfem_shelli_fail(hooks, DGFEM_ERROR_ARGUMENT, "relaxation is %g, expected in (0, 1]",
                                 (double)desc->relaxation);
    return dgfem_shelli_check_scalar(hooks, desc->tolerance, 1, "tolerance");
}

DGFEM_API dgfem_status dgfem_shell_solve_static(dgfem_shell *shell, const dgfem_shell_static_desc *desc,
                                                dgfem_shell_info *info) {
    dgfem_shell_info local = dgfem_shelli_empty_info();
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_static(shell, desc);
    if (status) return status;
    if (!dgfem_shelli_collect_held(shell))
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_UNCONSTRAINED, "no node is held");
    status = dgfem_shelli_follow_path(shell, desc, &local);
    shell->system->part = 1;
    dgfem_shelli_refresh_edges(shell);
    if (info) *info = local;
    if (status)
        return dgfem_shelli_fail(&shell->hooks, status, "static solve: %d iterations, residual %g, node %d",
                                 local.iterations, (double)local.residual, local.failed_node);
    memcpy(shell->position, dgfem_shelli_vector(shell, DGFEM_SHELLI_X), dgfem_shelli_bytes(shell));
    memset(shell->velocity, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_settle(shell);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_is_stable(dgfem_shell *shell, int *stable) {
    dgfem_shell_info info = dgfem_shelli_empty_info();
    if (!shell || !stable) return DGFEM_ERROR_ARGUMENT;
    (void)dgfem_shelli_collect_held(shell);
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, shell->position, shell->desc.corotational, 1, 1);
    dgfem_shelli_assemble_external(shell, shell->position, 1, 1);
    dgfem_shelli_hold_matrix(shell);
    dgfem_status status = dgfem_shelli_factor(shell, &info);
    *stable = !status;
    return status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE ? DGFEM_OK : status;
}

/* ==== step.c ====================================================================================================== */

/* Implicit Euler: one step solves, for the velocities v at its end,
     (1 + h alpha) M v + h (f_int(x + h v) + f_damp - F_ext - F_contact) = M v0,   x+ = x + h v,
   by Newton's method. Stiffness damping f_damp is the force of the stresses beta C (strain+ - strain) / h, about
   beta K v. Contact acts at the nodes. */

/* ---- contact ----

   A node at signed distance d of a shape, direction n, has the depth g = thickness / 2 - d. With its spring
   k = stiffness * E * thickness and relative velocity w
     f = n (k g - c n.w) - c_t (I - n n^T) w,  c = damping k,  c_t = friction * normal force / max(slip, slip speed).
   Friction follows the normal force at the beginning of the step. */

typedef struct dgfem_shelli_touch {
    dgfem_vec3 normal, relative;
    dgfem_real depth, spring, tangential;
} dgfem_shelli_touch;

/* 1 where node i, at x with velocity v, presses against the shape. */
static int dgfem_shelli_touches(const dgfem_shell *shell, const dgfem_shape *shape, int i, dgfem_vec3 x, dgfem_vec3 v,
                                dgfem_shelli_touch *touch) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 before;
    touch->depth = shell->node_half[i] - dgfem_shape_distance(shape, x, &touch->normal);
    touch->relative = dgfem_shelli_sub(v, desc->velocity);
    touch->spring = desc->stiffness * shell->node_spring[i];
    touch->tangential = 0;
    dgfem_real speed = dgfem_shelli_dot(touch->normal, touch->relative);
    if (!(touch->depth > 0) || !(touch->depth - desc->damping * speed > 0)) return 0;
    dgfem_real depth = shell->node_half[i] - dgfem_shape_distance(shape, shell->position[i], &before);
    if (!(depth > 0)) return 1;
    dgfem_vec3 slide = dgfem_shelli_axpy(touch->relative, -speed, touch->normal);
    touch->tangential =
        desc->friction * touch->spring * depth / dgfem_shelli_max(dgfem_shelli_norm(slide), desc->slip_speed);
    return 1;
}

/* out += factor * contact forces at x with velocities v. Returns the number of nodes that touch. */
static int dgfem_shelli_add_contact(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                    dgfem_real factor, dgfem_vec3 *out) {
    int count = 0;
    for (int i = 0; shell->shape_count && i < shell->node_count; i++) {
        int touching = 0;
        for (int s = 0; s < shell->shape_count; s++) {
            dgfem_shelli_touch touch;
            if (!dgfem_shelli_touches(shell, &shell->shapes[s], i, x[i], v[i], &touch)) continue;
            dgfem_real speed = dgfem_shelli_dot(touch.normal, touch.relative);
            dgfem_real push = touch.spring * (touch.depth - shell->shapes[s].desc.damping * speed);
            push += touch.tangential * speed;
            out[i] = dgfem_shelli_axpy(out[i], factor * push, touch.normal);
            out[i] = dgfem_shelli_axpy(out[i], -factor * touch.tangential, touch.relative);
            touching = 1;
        }
        count += touching;
    }
    return count;
}

/* matrix += minus the derivative of h F_contact by v, for x = x0 + h v. */
static void dgfem_shelli_assemble_contact(const dgfem_shell *shell, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                          dgfem_real h) {
    for (int i = 0; shell->shape_count && i < shell->node_count; i++)
        for (int s = 0; s < shell->shape_count; s++) {
            dgfem_shelli_touch touch;
            if (!dgfem_shelli_touches(shell, &shell->shapes[s], i, x[i], v[i], &touch)) continue;
            dgfem_real *block = shell->system->matrix->values + shell->system->diagonal[i];
            dgfem_real normal = h * touch.spring * (h + shell->shapes[s].desc.damping);
            dgfem_mat3 m;
            memcpy(&m, block, sizeof m);
            dgfem_shelli_add_outer(&m, normal - h * touch.tangential, touch.normal, touch.normal);
            for (int k = 0; k < 3; k++) m.m[k][k] += h * touch.tangential;
            memcpy(block, &m, sizeof m);
        }
}

/* ---- mass ---- */

/* out += factor * M v */
static void dgfem_shelli_add_momentum(const dgfem_shell *shell, dgfem_real factor, const dgfem_vec3 *v,
                                      dgfem_vec3 *out) {
    if (!shell->desc.consistent_mass) {
        for (int i = 0; i < shell->node_count; i++)
            out[i] = dgfem_shelli_axpy(out[i], factor * shell->node_mass[i], v[i]);
        return;
    }
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], w[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = factor * element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, x);
        dgfem_shelli_gather(v, element->node, n, w);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(shell->system, n, q);
            dgfem_vec3 flow =
                dgfem_shelli_scale(density * dgfem_shelli_fine_area(f, x, n, q), dgfem_shelli_sum(f->n, w, n));
            for (int a = 0; a < n; a++) out[element->node[a]] = dgfem_shelli_axpy(out[element->node[a]], f->n[a], flow);
        }
    }
}

/* matrix += factor * M */
static void dgfem_shelli_assemble_mass(const dgfem_shell *shell, dgfem_real factor) {
    const dgfem_shell_system *system = shell->system;
    dgfem_real *values = system->matrix->values;
    for (int i = 0; !shell->desc.consistent_mass && i < shell->node_count; i++)
        for (int k = 0; k < 9; k += 4) values[system->diagonal[i] + (size_t)k] += factor * shell->node_mass[i];
    for (int e = 0; shell->desc.consistent_mass && e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        const size_t *map = system->map + system->groups[e].map_start;
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = factor * element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, x);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(system, n, q);
            dgfem_real weight = density * dgfem_shelli_fine_area(f, x, n, q);
            const size_t *to = map;
            for (int a = 0; a < n; a++)
                for (int b = 0; b <= a; b++, to++)
                    for (size_t k = 0; k < 9; k += 4) values[*to + k] += weight * f->n[a] * f->n[b];
        }
    }
}

/* ---- one step ---- */

/* Velocities of held directions: those that reach their targets. */
static void dgfem_shelli_hold_velocities(const dgfem_shell *shell, dgfem_real h, dgfem_vec3 *v) {
    const dgfem_shell_system *system = shell->system;
    for (int i = 0; i < shell->node_count; i++) {
        if (!system->held[i]) continue;
        dgfem_vec3 wanted = dgfem_shelli_sub(dgfem_shelli_add(shell->rest[i], system->target[i]), shell->position[i]);
        wanted = dgfem_shelli_scale(1 / h, wanted);
        wanted = dgfem_shelli_sub(wanted, dgfem_shelli_multiply(&system->free_part[i], wanted));
        v[i] = dgfem_shelli_add(dgfem_shelli_multiply(&system->free_part[i], v[i]), wanted);
    }
}

/* Positions and residual of velocities v; sets the scale of the momenta that balance, which does not depend on how fast
   the frame moves. Returns the nodes in contact. */
static int dgfem_shelli_step_residual(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *v, dgfem_vec3 *x,
                                      dgfem_vec3 *r, dgfem_real *scale) {
    dgfem_vec3 *force = dgfem_shelli_vector(shell, DGFEM_SHELLI_FORCE);
    dgfem_vec3 *gain = dgfem_shelli_vector(shell, DGFEM_SHELLI_MOTION);
    dgfem_vec3 *momentum = dgfem_shelli_vector(shell, DGFEM_SHELLI_RHS);
    for (int i = 0; i < shell->node_count; i++) x[i] = dgfem_shelli_axpy(shell->position[i], h, v[i]);
    for (int i = 0; i < shell->node_count; i++) gain[i] = dgfem_shelli_sub(v[i], shell->velocity[i]);
    memset(force, 0, dgfem_shelli_bytes(shell));
    memset(momentum, 0, dgfem_shelli_bytes(shell));
    memset(r, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, x, !shell->desc.consistent_mass, h, force);
    int contacts = dgfem_shelli_add_contact(shell, x, v, h, force);
    (void)dgfem_shelli_add_internal(shell, x, shell->desc.damping_stiffness / h, h, r);
    dgfem_shelli_add_momentum(shell, 1, gain, momentum);
    *scale = dgfem_shelli_max(dgfem_shelli_length(shell, force), dgfem_shelli_length(shell, r));
    *scale = dgfem_shelli_max(*scale, dgfem_shelli_length(shell, momentum));
    dgfem_shelli_add_momentum(shell, h * shell->desc.damping_mass, v, momentum);
    for (int i = 0; i < shell->node_count; i++) r[i] = dgfem_shelli_sub(dgfem_shelli_sub(force[i], r[i]), momentum[i]);
    dgfem_shelli_hold_vector(shell, r);
    return contacts;
}

/* Round-off of the momenta that balance: of h f_int by that of positions, and of M v. Where nothing acts, as in free
   flight, no residual is smaller. */
static dgfem_real dgfem_shelli_step_floor(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x,
                                          const dgfem_vec3 *v, dgfem_real extent) {
    dgfem_real size = h * shell->system->stiffness * dgfem_shelli_reach(shell, x, extent), square = 0;
    for (int i = 0; i < shell->node_count; i++) {
        dgfem_real mass = dgfem_shelli_max(shell->node_mass[i], shell->node_load[i]);
        square += mass * mass * (dgfem_shelli_dot(v[i], v[i]));
    }
    return 4 * DGFEM_SHELL_EPSILON * (size + dgfem_shelli_sqrt(square));
}

/* Matrix of a step: (1 + h alpha) M + h^2 K + h beta K_frozen, loads and contact. Loads that make it indefinite are
   left out with the rest of the tangent where `spins` is 0. */
static void dgfem_shelli_assemble_step(const dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                       int spins) {
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, x, spins, 1 + shell->desc.damping_stiffness / h, h * h);
    shell->system->stiffness =
        dgfem_shelli_shift_diagonal(shell, 0) / (h * h * (1 + shell->desc.damping_stiffness / h));
    dgfem_shelli_assemble_external(shell, x, spins, h * h);
    dgfem_shelli_assemble_mass(shell, 1 + h * shell->desc.damping_mass);
    dgfem_shelli_assemble_contact(shell, x, v, h);
    dgfem_shelli_hold_matrix(shell);
}

/* Factors the matrix of a step. Where a buckling shell makes it indefinite, more and more mass is added, as if the step
   were shorter, and at last rotations are frozen. */
static dgfem_status dgfem_shelli_factor_step(dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, const dgfem_vec3 *v,
                                             dgfem_shell_info *info) {
    double start = dgfem_shelli_clock(&shell->hooks);
    dgfem_real mass = 1;
    dgfem_shelli_assemble_step(shell, h, x, v, shell->desc.corotational);
    info->seconds_assemble += dgfem_shelli_clock(&shell->hooks) - start;
    dgfem_status status = dgfem_shelli_factor(shell, info);
    for (int k = 0; k < 5 && status == DGFEM_ERROR_NOT_POSITIVE_DEFINITE; k++, mass *= 4) {
        dgfem_shelli_assemble_mass(shell, mass);
        dgfem_shelli_hold_matrix(shell);
        info->shifts++;
        status = dgfem_shelli_factor(shell, info);
    }
    if (status != DGFEM_ERROR_NOT_POSITIVE_DEFINITE) return status;
    dgfem_shelli_assemble_step(shell, h, x, v, 0);
    return dgfem_shelli_factor_shifted(shell, info);
}

/* One Newton iteration: v += A^-1 r. */
static dgfem_status dgfem_shelli_step_solve(dgfem_shell *shell, dgfem_real h, const dgfem_vec3 *x, dgfem_vec3 *v,
                                            int frozen, dgfem_shell_info *info) {
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_vec3 *solution = dgfem_shelli_vector(shell, DGFEM_SHELLI_SOLUTION);
    dgfem_status status;
    if (frozen) {
        dgfem_shelli_assemble_step(shell, h, x, v, 0);
        status = dgfem_shelli_factor_shifted(shell, info);
    } else {
        status = dgfem_shelli_factor_step(shell, h, x, v, info);
    }
    if (!status) status = dgfem_shelli_solve(shell, r, solution, info);
    if (status) return status;
    dgfem_shelli_hold_vector(shell, solution);
    for (int i = 0; i < shell->node_count; i++) v[i] = dgfem_shelli_add(v[i], solution[i]);
    return DGFEM_OK;
}

/* The step where Newton's method got nowhere: semi-implicit, with rotations and contacts of its beginning. */
static dgfem_status dgfem_shelli_step_frozen(dgfem_shell *shell, dgfem_real h, dgfem_shell_info *info) {
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_real scale;
    memset(v, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_hold_velocities(shell, h, v);
    (void)dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    dgfem_status status = dgfem_shelli_step_solve(shell, h, x, v, 1, info);
    if (status) return status;
    info->iterations++;
    info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    dgfem_real residual = dgfem_shelli_length(shell, r);
    info->residual = scale > 0 ? residual / scale : 0;
    return dgfem_shelli_is_finite(residual) ? DGFEM_OK : DGFEM_ERROR_NOT_FINITE;
}

static dgfem_status dgfem_shelli_step(dgfem_shell *shell, dgfem_real h, dgfem_shell_info *info) {
    const dgfem_real lost = DGFEM_R(0.1); /* a residual that is as good as none */
    dgfem_vec3 *x = dgfem_shelli_vector(shell, DGFEM_SHELLI_X), *v = dgfem_shelli_vector(shell, DGFEM_SHELLI_V);
    dgfem_vec3 *r = dgfem_shelli_vector(shell, DGFEM_SHELLI_RESIDUAL);
    dgfem_real scale, extent = dgfem_shelli_extent(shell);
    (void)dgfem_shelli_collect_held(shell);
    if (shell->desc.damping_stiffness > 0) dgfem_shelli_keep_strains(shell);
    memcpy(v, shell->velocity, dgfem_shelli_bytes(shell));
    dgfem_shelli_hold_velocities(shell, h, v);
    info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
    for (;;) {
        dgfem_status status = dgfem_shelli_step_solve(shell, h, x, v, 0, info);
        if (status) return status;
        info->iterations++;
        info->contacts = dgfem_shelli_step_residual(shell, h, v, x, r, &scale);
        dgfem_real residual = dgfem_shelli_length(shell, r);
        info->residual = scale > 0 ? residual / scale : 0;
        if (residual <= shell->desc.step_tolerance * scale) break;
        if (residual <= dgfem_shelli_step_floor(shell, h, x, v, extent)) break;
        if (info->iterations >= shell->desc.step_iterations || !dgfem_shelli_is_finite(residual))
            return residual <= lost * scale ? DGFEM_OK : dgfem_shelli_step_frozen(shell, h, info);
        if (!shell->desc.corotational && !shell->shape_count) break;
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_step(dgfem_shell *shell, dgfem_real dt, dgfem_shell_info *info) {
    dgfem_shell_info local = dgfem_shelli_empty_info();
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_scalar(&shell->hooks, dt, 1, "dt");
    if (status) return status;
    status = dgfem_shelli_step(shell, dt, &local);
    if (info) *info = local;
    if (status)
        return dgfem_shelli_fail(&shell->hooks, status, "step: %d iterations, residual %g, node %d", local.iterations,
                                 (double)local.residual, local.failed_node);
    memcpy(shell->position, dgfem_shelli_vector(shell, DGFEM_SHELLI_X), dgfem_shelli_bytes(shell));
    memcpy(shell->velocity, dgfem_shelli_vector(shell, DGFEM_SHELLI_V), dgfem_shelli_bytes(shell));
    dgfem_shelli_settle(shell);
    shell->time += (double)dt;
    return DGFEM_OK;
}

/* ==== query.c ===================================================================================================== */

/* What can be asked about a shell's state. */

/* Values per node come as an array of node_count triples. */
static dgfem_status dgfem_shelli_set_nodes(dgfem_shell *shell, const dgfem_points_in *points, const char *what,
                                           dgfem_vec3 *out) {
    dgfem_status status = dgfem_shelli_check_points(&shell->hooks, points, what);
    if (status) return status;
    if (points->count != shell->node_count)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "%s: %d points for %d nodes", what, points->count,
                                 shell->node_count);
    for (int i = 0; i < points->count; i++)
        if (!dgfem_shelli_is_finite3(dgfem_shelli_read_point(points, i)))
            return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_NOT_FINITE, "%s: node %d", what, i);
    for (int i = 0; i < points->count; i++) out[i] = dgfem_shelli_read_point(points, i);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_set_positions(dgfem_shell *shell, dgfem_points_in positions) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    return dgfem_shelli_set_nodes(shell, &positions, "positions", shell->position);
}

DGFEM_API dgfem_status dgfem_shell_set_velocities(dgfem_shell *shell, dgfem_points_in velocities) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    return dgfem_shelli_set_nodes(shell, &velocities, "velocities", shell->velocity);
}

/* ---- points of elements ---- */

static dgfem_status dgfem_shelli_check_point(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b) {
    if (element < 0 || element >= shell->element_count)
        return dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, shell->element_count);
    dgfem_status status = dgfem_shelli_check_real(shell, a, "parameter");
    return status ? status : dgfem_shelli_check_real(shell, b, "parameter");
}

DGFEM_API dgfem_status dgfem_shell_evaluate(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                            dgfem_vec3 *position, dgfem_vec3 *normal) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_point(shell, element, a, b);
    if (status) return status;
    const dgfem_shell_element *e = &shell->elements[element];
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_basis f;
    dgfem_shelli_gather(shell->position, e->node, e->node_count, x);
    dgfem_shelli_basis_at(e->node_count, dgfem_shelli_parameter_make(a, b), &f);
    if (position) *position = dgfem_shelli_sum(f.n, x, e->node_count);
    if (normal)
        *normal = dgfem_shelli_unit(
            dgfem_shelli_cross(dgfem_shelli_sum(f.d1, x, e->node_count), dgfem_shelli_sum(f.d2, x, e->node_count)));
    return DGFEM_OK;
}

/* Tensor components from parametric 11, 22, 2*12 (covariant) to the orthonormal axes f1, f2. */
static void dgfem_shelli_to_axes(const dgfem_shelli_frame *frame, dgfem_vec3 f1, dgfem_vec3 f2, const dgfem_real *in,
                                 dgfem_real *out) {
    dgfem_real a1 = dgfem_shelli_dot(frame->c1, f1), a2 = dgfem_shelli_dot(frame->c2, f1);
    dgfem_real b1 = dgfem_shelli_dot(frame->c1, f2), b2 = dgfem_shelli_dot(frame->c2, f2);
    out[0] = in[0] * a1 * a1 + in[1] * a2 * a2 + in[2] * a1 * a2;
    out[1] = in[0] * b1 * b1 + in[1] * b2 * b2 + in[2] * b1 * b2;
    out[2] = in[0] * a1 * b1 + in[1] * a2 * b2 + DGFEM_R(0.5) * in[2] * (a1 * b2 + a2 * b1);
}

/* Plane stress: in[3] tensor components of strain, out[3] of stress. */
static void dgfem_shelli_plane_stress(dgfem_real stiffness, dgfem_real nu, const dgfem_real *in, dgfem_real *out) {
    out[0] = stiffness * (in[0] + nu * in[1]);
    out[1] = stiffness * (in[1] + nu * in[0]);
    out[2] = stiffness * (1 - nu) * in[2];
}

/* The rotation at any point of an element, as at its quadrature points. */
static dgfem_mat3 dgfem_shelli_rotation_at(const dgfem_shell *shell, const dgfem_shelli_basis *f,
                                           const dgfem_shelli_frame *frame, const dgfem_vec3 *x, int n) {
    dgfem_vec3 e1 = dgfem_shelli_sum(f->d1, x, n), e2 = dgfem_shelli_sum(f->d2, x, n);
    dgfem_mat3 gradient, identity = dgfem_shelli_identity();
    if (!shell->desc.corotational) return identity;
    memset(&gradient, 0, sizeof gradient);
    dgfem_shelli_add_outer(&gradient, 1, e1, frame->c1);
    dgfem_shelli_add_outer(&gradient, 1, e2, frame->c2);
    dgfem_shelli_add_outer(&gradient, 1, dgfem_shelli_unit(dgfem_shelli_cross(e1, e2)), frame->t);
    return dgfem_shelli_polar(&gradient, &identity);
}

DGFEM_API dgfem_status dgfem_shell_strain_at(const dgfem_shell *shell, int element, dgfem_real a, dgfem_real b,
                                             dgfem_shell_strain *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_point(shell, element, a, b);
    if (status) return status;
    const dgfem_shell_element *e = &shell->elements[element];
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], rest[DGFEM_SHELL_MAX_NODES];
    dgfem_shelli_basis f;
    dgfem_shelli_frame frame;
    dgfem_real rows[18 * DGFEM_SHELL_MAX_NODES], strain[6];
    int n = e->node_count;
    dgfem_shelli_gather(shell->position, e->node, n, x);
    dgfem_shelli_gather(shell->rest, e->node, n, rest);
    dgfem_shelli_basis_at(n, dgfem_shelli_parameter_make(a, b), &f);
    if (!dgfem_shelli_frame_at(&f, rest, n, &frame)) return dgfem_shelli_fail_degenerate(shell, element);
    out->rotation = dgfem_shelli_rotation_at(shell, &f, &frame, x, n);
    for (int i = n - 1; i >= 0; i--)
        x[i] = dgfem_shelli_sub(dgfem_shelli_multiply_transposed(&out->rotation, dgfem_shelli_sub(x[i], x[0])),
                                dgfem_shelli_sub(rest[i], rest[0]));
    dgfem_shelli_membrane_rows(&f, &frame, n, rows);
    dgfem_shelli_bending_rows(&f, &frame, n, rows + 9 * n);
    for (int i = 0; i < 6; i++) strain[i] = dgfem_shelli_row_product(rows + 3 * n * i, x, n);
    dgfem_vec3 f1 = dgfem_shelli_unit(frame.e1), f2 = dgfem_shelli_cross(frame.t, f1);
    out->frame.m[0][0] = f1.x, out->frame.m[1][0] = f1.y, out->frame.m[2][0] = f1.z;
    out->frame.m[0][1] = f2.x, out->frame.m[1][1] = f2.y, out->frame.m[2][1] = f2.z;
    out->frame.m[0][2] = frame.t.x, out->frame.m[1][2] = frame.t.y, out->frame.m[2][2] = frame.t.z;
    dgfem_shelli_to_axes(&frame, f1, f2, strain, out->membrane);
    dgfem_shelli_to_axes(&frame, f1, f2, strain + 3, out->bending);
    dgfem_shelli_plane_stress(dgfem_shelli_membrane_stiffness(e), e->material.poisson, out->membrane, out->force);
    dgfem_shelli_plane_stress(dgfem_shelli_bending_stiffness(e), e->material.poisson, out->bending, out->moment);
    return DGFEM_OK;
}

/* ---- forces and stiffness ---- */

DGFEM_API dgfem_status dgfem_shell_internal_force(const dgfem_shell *shell, dgfem_vec3 *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    (void)dgfem_shelli_add_internal(shell, shell->position, 0, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_tangent_multiply(const dgfem_shell *shell, const dgfem_vec3 *direction,
                                                    dgfem_vec3 *out) {
    if (!shell || !direction || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_tangent_product(shell, shell->position, direction, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_external_force(const dgfem_shell *shell, dgfem_vec3 *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, dgfem_shelli_bytes(shell));
    dgfem_shelli_add_external(shell, shell->position, 0, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_stiffness(dgfem_shell *shell, int tangent, const dgfem_matrix **out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_matrix_clear(shell->system->matrix);
    dgfem_shelli_assemble(shell, shell->position, tangent && shell->desc.corotational, 1, 1);
    *out = shell->system->matrix;
    return DGFEM_OK;
}

/* ---- totals ---- */

/* Kinetic energy, momentum, and angular momentum about the origin, with the mass matrix that steps use. */
typedef struct dgfem_shelli_motion {
    dgfem_real kinetic;
    dgfem_vec3 linear, angular;
} dgfem_shelli_motion;

static void dgfem_shelli_add_motion(dgfem_shelli_motion *motion, dgfem_real mass, dgfem_vec3 x, dgfem_vec3 v) {
    dgfem_vec3 mv = dgfem_shelli_scale(mass, v);
    motion->kinetic += DGFEM_R(0.5) * dgfem_shelli_dot(mv, v);
    motion->linear = dgfem_shelli_add(motion->linear, mv);
    motion->angular = dgfem_shelli_add(motion->angular, dgfem_shelli_cross(x, mv));
}

static dgfem_shelli_motion dgfem_shelli_total_motion(const dgfem_shell *shell) {
    dgfem_shelli_motion motion;
    memset(&motion, 0, sizeof motion);
    for (int i = 0; !shell->desc.consistent_mass && i < shell->node_count; i++)
        dgfem_shelli_add_motion(&motion, shell->node_mass[i], shell->position[i], shell->velocity[i]);
    for (int e = 0; shell->desc.consistent_mass && e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 rest[DGFEM_SHELL_MAX_NODES], x[DGFEM_SHELL_MAX_NODES], v[DGFEM_SHELL_MAX_NODES];
        int n = element->node_count;
        dgfem_real density = element->thickness * element->material.density;
        dgfem_shelli_gather(shell->rest, element->node, n, rest);
        dgfem_shelli_gather(shell->position, element->node, n, x);
        dgfem_shelli_gather(shell->velocity, element->node, n, v);
        for (int q = 0; q < dgfem_shelli_fine_count(n); q++) {
            const dgfem_shelli_basis *f = dgfem_shelli_fine_basis(shell->system, n, q);
            dgfem_shelli_add_motion(&motion, density * dgfem_shelli_fine_area(f, rest, n, q),
                                    dgfem_shelli_sum(f->n, x, n), dgfem_shelli_sum(f->n, v, n));
        }
    }
    return motion;
}

DGFEM_API dgfem_status dgfem_shell_energy(const dgfem_shell *shell, dgfem_energy *out) {
    if (!shell || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, sizeof *out);
    out->elastic = dgfem_shelli_add_internal(shell, shell->position, 0, 1, NULL);
    out->kinetic = dgfem_shelli_total_motion(shell).kinetic;
    const dgfem_real *weight = shell->desc.consistent_mass ? shell->node_load : shell->node_mass;
    for (int i = 0; i < shell->node_count; i++)
        out->gravity -= weight[i] * dgfem_shelli_dot(shell->desc.gravity, shell->position[i]);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_shell_momentum(const dgfem_shell *shell, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_shelli_motion motion = dgfem_shelli_total_motion(shell);
    if (linear) *linear = motion.linear;
    if (angular) *angular = motion.angular;
    return DGFEM_OK;
}

DGFEM_API dgfem_real dgfem_shell_mass(const dgfem_shell *shell) {
    dgfem_real mass = 0;
    for (int i = 0; shell && i < shell->node_count; i++) mass += shell->node_mass[i];
    return mass;
}

DGFEM_API dgfem_real dgfem_shell_area(const dgfem_shell *shell) {
    dgfem_real area = 0;
    for (int e = 0; shell && e < shell->element_count; e++) area += shell->elements[e].area;
    return area;
}

/* ==== cut.c ======================================================================================================= */

/* Topology that changes: edges separated or turned into hinges, elements split along a plane.

   Every change builds a new topology beside the old one and takes its place only when all of it has succeeded. Middle
   nodes tell edges apart, so that separating two elements means giving one of them a middle node of its own; corners
   are doubled where the elements around them no longer hang together. */

DGFEM_API dgfem_shell_cut_desc dgfem_default_shell_cut_desc(void) {
    dgfem_shell_cut_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.plane.normal.x = 1;
    desc.current = 1;
    desc.snap = DGFEM_R(0.1);
    desc.joint = DGFEM_SHELL_GAP;
    return desc;
}

/* What a new topology is made of, and where its nodes and edges come from. */
typedef struct dgfem_shelli_edit {
    const dgfem_shell *old;
    dgfem_shelli_scratch scratch;
    dgfem_shell_element *elements;
    int element_count, element_capacity, node_count, node_capacity;
    dgfem_vec3 *rest, *position, *velocity; /* [node_capacity] */
    int *element_from;                      /* [element_capacity] the old element that an element is (a piece of) */
    int *parent;                            /* [node_capacity] the old node that a node copies, or DGFEM_NONE */
    int *on_edge;   /* [node_capacity] of a new node: the old edge that it lies on, or DGFEM_NONE */
    int *edge_from; /* [node_capacity] of a middle node: the old edge that its edge is (a part of), or DGFEM_NONE */
    char *joint;    /* [node_capacity] of a middle node: what becomes of its edge */
    int *moved_to;  /* [old nodes] of a middle node whose edge was split: the new middle node of the part it was on */
    char *to_crossing; /* [old nodes] and whether the crossing is nearer to where it was than that */
} dgfem_shelli_edit;

static dgfem_status dgfem_shelli_edit_begin(dgfem_shelli_edit *edit, const dgfem_shell *shell, int elements,
                                            int nodes) {
    memset(edit, 0, sizeof *edit);
    edit->old = shell;
    edit->scratch = dgfem_shelli_scratch_make(&shell->hooks);
    edit->element_capacity = elements;
    edit->node_capacity = nodes;
    edit->element_count = shell->element_count;
    edit->node_count = shell->node_count;
    size_t n = (size_t)nodes;
    edit->elements = (dgfem_shell_element *)dgfem_shelli_take(&edit->scratch, (size_t)elements, sizeof *edit->elements);
    edit->rest = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->position = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->velocity = (dgfem_vec3 *)dgfem_shelli_take(&edit->scratch, n, sizeof(dgfem_vec3));
    edit->element_from = (int *)dgfem_shelli_take(&edit->scratch, (size_t)elements, sizeof(int));
    edit->on_edge = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->parent = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->edge_from = (int *)dgfem_shelli_take(&edit->scratch, n, sizeof(int));
    edit->joint = (char *)dgfem_shelli_take(&edit->scratch, n, 1);
    edit->moved_to = (int *)dgfem_shelli_take(&edit->scratch, (size_t)shell->node_count, sizeof(int));
    edit->to_crossing = (char *)dgfem_shelli_take(&edit->scratch, (size_t)shell->node_count, 1);
    if (!edit->elements || !edit->rest || !edit->position || !edit->velocity || !edit->parent || !edit->edge_from ||
        !edit->joint || !edit->element_from || !edit->on_edge || !edit->moved_to || !edit->to_crossing)
        return DGFEM_ERROR_MEMORY;
    memcpy(edit->elements, shell->elements, (size_t)shell->element_count * sizeof *edit->elements);
    memcpy(edit->rest, shell->rest, dgfem_shelli_bytes(shell));
    memcpy(edit->position, shell->position, dgfem_shelli_bytes(shell));
    memcpy(edit->velocity, shell->velocity, dgfem_shelli_bytes(shell));
    for (int i = 0; i < nodes; i++) {
        edit->parent[i] = i < shell->node_count ? i : DGFEM_NONE;
        edit->edge_from[i] = edit->on_edge[i] = DGFEM_NONE;
    }
    for (int i = 0; i < shell->node_count; i++) edit->moved_to[i] = DGFEM_NONE;
    for (int e = 0; e < shell->element_count; e++) edit->element_from[e] = e;
    for (int i = 0; i < shell->edge_count; i++) {
        edit->edge_from[shell->edges[i].node[2]] = i;
        edit->joint[shell->edges[i].node[2]] = (char)shell->edges[i].joint;
    }
    return DGFEM_OK;
}

static int dgfem_shelli_edit_node(dgfem_shelli_edit *edit, dgfem_vec3 rest, dgfem_vec3 position, dgfem_vec3 velocity) {
    DGFEM_ASSERT(edit->node_count < edit->node_capacity);
    int i = edit->node_count++;
    edit->rest[i] = rest, edit->position[i] = position, edit->velocity[i] = velocity;
    edit->parent[i] = edit->edge_from[i] = edit->on_edge[i] = DGFEM_NONE;
    edit->joint[i] = DGFEM_SHELL_GLUED;
    return i;
}

static int dgfem_shelli_edit_copy(dgfem_shelli_edit *edit, int node) {
    int i = dgfem_shelli_edit_node(edit, edit->rest[node], edit->position[node], edit->velocity[node]);
    edit->parent[i] = edit->parent[node];
    edit->edge_from[i] = edit->edge_from[node];
    edit->on_edge[i] = edit->on_edge[node];
    edit->joint[i] = edit->joint[node];
    return i;
}

/* ---- separating ---- */

static int dgfem_shelli_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Elements as seen from their corners: number 4 e + k. Those joined around a node, through edges that are no gaps,
   become one class. side_of[] ends as the last side 4 e + k at each middle node. */
static void dgfem_shelli_join_corners(const dgfem_shelli_edit *edit, int *class_of, int *side_of) {
    for (int i = 0; i < 4 * edit->element_count; i++) class_of[i] = i;
    for (int i = 0; i < edit->node_count; i++) side_of[i] = DGFEM_NONE;
    for (int e = 0; e < edit->element_count; e++) {
        const dgfem_shell_element *element = &edit->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) {
            int middle = element->node[corners + k], other = side_of[middle];
            side_of[middle] = 4 * e + k;
            if (other == DGFEM_NONE || edit->joint[middle] == DGFEM_SHELL_GAP) continue;
            int f = other / 4, l = other % 4, count = dgfem_shelli_corners(&edit->elements[f]);
            int next = 4 * e + (k + 1) % corners,
                after = 4 * f + (l + 1) % count; /* neighbours run against each other */
            class_of[dgfem_shelli_root(class_of, 4 * e + k)] = dgfem_shelli_root(class_of, after);
            class_of[dgfem_shelli_root(class_of, next)] = dgfem_shelli_root(class_of, 4 * f + l);
        }
    }
}

/* Doubles the middle nodes of gaps and the corners around which elements fall apart. Room for a copy per side and per
   corner must be there. Returns the number of edges separated, or -1 when out of memory. */
static int dgfem_shelli_edit_separate(dgfem_shelli_edit *edit) {
    int count = edit->element_count, separated = 0, nodes = edit->node_count;
    int *class_of = (int *)dgfem_shelli_take(&edit->scratch, 4 * (size_t)count, sizeof(int));
    int *side_of = (int *)dgfem_shelli_take(&edit->scratch, (size_t)edit->node_capacity, sizeof(int));
    int *owner = (int *)dgfem_shelli_take(&edit->scratch, (size_t)edit->node_capacity, sizeof(int));
    int *copy = (int *)dgfem_shelli_take(&edit->scratch, 4 * (size_t)count, sizeof(int));
    if (!class_of || !side_of || !owner || !copy) return -1;
    dgfem_shelli_join_corners(edit, class_of, side_of);
    for (int i = 0; i < nodes; i++) owner[i] = DGFEM_NONE;
    for (int i = 0; i < 4 * count; i++) copy[i] = DGFEM_NONE;
    for (int e = 0; e < count; e++) {
        dgfem_shell_element *element = &edit->elements[e];
        int corners = dgfem_shelli_corners(element);
        for (int k = 0; k < corners; k++) { /* the first class around a node keeps it */
            int root = dgfem_shelli_root(class_of, 4 * e + k), node = element->node[k];
            if (owner[node] == DGFEM_NONE) owner[node] = root, copy[root] = node;
            if (copy[root] == DGFEM_NONE) copy[root] = dgfem_shelli_edit_copy(edit, node);
            element->node[k] = copy[root];
        }
        for (int k = corners; k < 2 * corners; k++) {
            int node = element->node[k];
            if (edit->joint[node] != DGFEM_SHELL_GAP || side_of[node] == 4 * e + k - corners) continue;
            element->node[k] = dgfem_shelli_edit_copy(edit, node);
            separated++;
        }
    }
    for (int i = 0; i < edit->node_count; i++)
        if (edit->joint[i] == DGFEM_SHELL_GAP) edit->joint[i] = DGFEM_SHELL_GLUED; /* boundary now */
    return separated;
}

/* ---- the new topology ---- */

/* For each old item the new ones that come from it: list[start[i]] .. list[start[i + 1] - 1]. */
typedef struct dgfem_shelli_heirs {
    int *start, *list;
} dgfem_shelli_heirs;

/* from[i]: the old item that the new item i comes from, or DGFEM_NONE. */
static int dgfem_shelli_heirs_make(dgfem_shelli_scratch *scratch, const int *from, int count, int old_count,
                                   dgfem_shelli_heirs *out) {
    out->start = (int *)dgfem_shelli_take(scratch, (size_t)old_count + 2, sizeof(int));
    out->list = (int *)dgfem_shelli_take(scratch, (size_t)count, sizeof(int));
    if (!out->start || !out->list) return 0;
    int *next = out->start + 1; /* becomes the start once its items are in */
    for (int i = 0; i < count; i++)
        if (from[i] != DGFEM_NONE) out->start[from[i] + 2]++;
    for (int i = 0; i < old_count; i++) next[i + 1] += next[i];
    for (int i = 0; i < count; i++)
        if (from[i] != DGFEM_NONE) out->list[next[from[i]]++] = i;
    return 1;
}

/* What the conditions of a new topology are found by. */
typedef struct dgfem_shelli_renewal {
    const dgfem_shelli_edit *edit;
    const dgfem_shell *next;
    dgfem_shelli_heirs nodes, on_edge, edges, elements; /* copies of nodes; new nodes on edges; and parts */
    int *load_node;                                     /* [old nodes] where forces and pins go */
    int *edge_of;                                       /* [old nodes] of middle nodes: the edge, or DGFEM_NONE */
    char *mark;                                         /* [old nodes] all 0 between uses */
} dgfem_shelli_renewal;

/* Forces and pins stay with the node's number. A middle node that has moved to a crossing passes them on to the nearest
   node on its own side of it. */
static void dgfem_shelli_find_load_nodes(const dgfem_shelli_renewal *renewal) {
    const dgfem_shelli_edit *edit = renewal->edit;
    for (int i = 0; i < edit->old->node_count; i++) renewal->load_node[i] = i;
    for (int i = 0; i < renewal->next->edge_count; i++) {
        const int *node = renewal->next->edges[i].node;
        int split = edit->on_edge[node[2]];
        if (split == DGFEM_NONE) continue;
        int middle = edit->old->edges[split].node[2];
        if (edit->moved_to[middle] != node[2]) continue;
        renewal->load_node[middle] = node[2];
        for (int a = 0; a < 2; a++)
            if (edit->to_crossing[middle] && edit->parent[node[a]] == middle) renewal->load_node[middle] = node[a];
    }
}

static int dgfem_shelli_renewal_make(dgfem_shelli_renewal *renewal, dgfem_shelli_edit *edit, const dgfem_shell *next) {
    const dgfem_shell *old = edit->old;
    dgfem_shelli_scratch *scratch = &edit->scratch;
    renewal->edit = edit;
    renewal->next = next;
    int *from = (int *)dgfem_shelli_take(scratch, (size_t)next->edge_count, sizeof(int));
    renewal->load_node = (int *)dgfem_shelli_take(scratch, (size_t)old->node_count, sizeof(int));
    renewal->edge_of = (int *)dgfem_shelli_take(scratch, (size_t)old->node_count, sizeof(int));
    renewal->mark = (char *)dgfem_shelli_take(scratch, (size_t)old->node_count, 1);
    if (!from || !renewal->load_node || !renewal->edge_of || !renewal->mark) return 0;
    for (int i = 0; i < next->edge_count; i++) from[i] = edit->edge_from[next->edges[i].node[2]];
    for (int i = 0; i < old->node_count; i++) renewal->edge_of[i] = DGFEM_NONE;
    for (int i = 0; i < old->edge_count; i++) renewal->edge_of[old->edges[i].node[2]] = i;
    dgfem_shelli_find_load_nodes(renewal);
    return dgfem_shelli_heirs_make(scratch, edit->parent, next->node_count, old->node_count, &renewal->nodes) &&
           dgfem_shelli_heirs_make(scratch, edit->on_edge, next->node_count, old->edge_count, &renewal->on_edge) &&
           dgfem_shelli_heirs_make(scratch, from, next->edge_count, old->edge_count, &renewal->edges) &&
           dgfem_shelli_heirs_make(scratch, edit->element_from, next->element_count, old->element_count,
                                   &renewal->elements);
}

/* Writes the heirs of an item, unless out is NULL. Returns how many there are. */
static int dgfem_shelli_pass_on(const dgfem_shelli_heirs *heirs, int item, int *out) {
    int count = heirs->start[item + 1] - heirs->start[item];
    if (out && count) memcpy(out, heirs->list + heirs->start[item], (size_t)count * sizeof(int));
    return count;
}

/* Fixtures hold all copies of their nodes, and what is new on edges all of whose nodes they hold. */
static int dgfem_shelli_pass_fixture(const dgfem_shelli_renewal *renewal, const char *mark, int item, int *out) {
    int edge = renewal->edge_of[item], count = dgfem_shelli_pass_on(&renewal->nodes, item, out);
    if (edge == DGFEM_NONE) return count;
    const int *node = renewal->edit->old->edges[edge].node;
    if (!mark[node[0]] || !mark[node[1]]) return count;
    return count + dgfem_shelli_pass_on(&renewal->on_edge, edge, out ? out + count : NULL);
}

/* One of the two sides of an edge that came apart keeps its load. */
static int dgfem_shelli_pass_line_load(const dgfem_shelli_renewal *renewal, int item, int *out) {
    int count = 0;
    for (int i = renewal->edges.start[item]; i < renewal->edges.start[item + 1]; i++) {
        int edge = renewal->edges.list[i], middle = renewal->next->edges[edge].node[2];
        int parent = renewal->edit->parent[middle];
        if (parent != DGFEM_NONE && parent != middle) continue;
        if (out) out[count] = edge;
        count++;
    }
    return count;
}

/* The items of a condition in the new topology. Returns their number; out may be NULL. */
static int dgfem_shelli_renew_items(const dgfem_shelli_renewal *renewal, const dgfem_shell_condition *old,
                                    const char *mark, int *out) {
    int count = 0;
    for (int i = 0; i < old->count; i++) {
        int item = old->items[i], *to = out ? out + count : NULL;
        switch (old->kind) {
        case DGFEM_SHELL_CONDITION_FIX: count += dgfem_shelli_pass_fixture(renewal, mark, item, to); break;
        case DGFEM_SHELL_CONDITION_FORCE:
        case DGFEM_SHELL_CONDITION_PIN:
            if (to) *to = renewal->load_node[item];
            count++;
            break;
        case DGFEM_SHELL_CONDITION_PRESSURE: count += dgfem_shelli_pass_on(&renewal->elements, item, to); break;
        case DGFEM_SHELL_CONDITION_LINE_LOAD: count += dgfem_shelli_pass_line_load(renewal, item, to); break;
        default: count += dgfem_shelli_pass_on(&renewal->edges, item, to);
        }
    }
    return count;
}

static dgfem_status dgfem_shelli_renew_condition(const dgfem_shelli_renewal *renewal, const dgfem_shell_condition *old,
                                                 dgfem_shell_condition *out) {
    int fixture = old->kind == DGFEM_SHELL_CONDITION_FIX;
    *out = *old;
    for (int i = 0; fixture && i < old->count; i++) renewal->mark[old->items[i]] = 1;
    out->count = dgfem_shelli_renew_items(renewal, old, renewal->mark, NULL);
    out->items = (int *)dgfem_shelli_allocate(&renewal->next->hooks, (size_t)out->count, sizeof(int));
    if (out->items) (void)dgfem_shelli_renew_items(renewal, old, renewal->mark, out->items);
    for (int i = 0; fixture && i < old->count; i++) renewal->mark[old->items[i]] = 0;
    if (!out->items) return DGFEM_ERROR_MEMORY;
    if (old->kind == DGFEM_SHELL_CONDITION_PIN) { /* its place goes with its node */
        dgfem_vec3 moved =
            dgfem_shelli_sub(renewal->next->position[out->items[0]], renewal->edit->old->position[old->items[0]]);
        out->vector = dgfem_shelli_add(out->vector, moved);
        out->vector_before = dgfem_shelli_add(out->vector_before, moved);
    }
    return DGFEM_OK;
}

static dgfem_status dgfem_shelli_renew_conditions(dgfem_shelli_edit *edit, dgfem_shell *next) {
    const dgfem_shell *old = edit->old;
    dgfem_shelli_renewal renewal;
    next->condition_count = 0;
    next->conditions = (dgfem_shell_condition *)dgfem_shelli_allocate(&next->hooks, (size_t)old->condition_capacity,
                                                                      sizeof *next->conditions);
    if (!next->conditions || !dgfem_shelli_renewal_make(&renewal, edit, next)) return DGFEM_ERROR_MEMORY;
    for (int c = 0; c < old->condition_count; c++) {
        dgfem_status status = dgfem_shelli_renew_condition(&renewal, &old->conditions[c], &next->conditions[c]);
        if (status) return status;
        next->condition_count++;
    }
    return DGFEM_OK;
}

static void dgfem_shelli_free_conditions(dgfem_shell *shell) {
    for (int c = 0; c < shell->condition_count; c++) dgfem_shelli_free(&shell->hooks, shell->conditions[c].items);
    dgfem_shelli_free(&shell->hooks, shell->conditions);
}

static dgfem_status dgfem_shelli_edit_build(dgfem_shelli_edit *edit, dgfem_shell *next) {
    next->element_count = edit->element_count;
    next->node_count = edit->node_count;
    if (!dgfem_shelli_allocate_elements(next) || !dgfem_shelli_allocate_nodes(next)) return DGFEM_ERROR_MEMORY;
    memcpy(next->elements, edit->elements, (size_t)next->element_count * sizeof *next->elements);
    memcpy(next->rest, edit->rest, dgfem_shelli_bytes(next));
    memcpy(next->position, edit->position, dgfem_shelli_bytes(next));
    memcpy(next->velocity, edit->velocity, dgfem_shelli_bytes(next));
    dgfem_status status = dgfem_shelli_connect(next);
    if (!status) status = dgfem_shelli_measure(next);
    if (status) return status;
    for (int i = 0; i < next->edge_count; i++)
        if (!dgfem_shelli_is_boundary(&next->edges[i]))
            next->edges[i].joint = (dgfem_shell_joint)edit->joint[next->edges[i].node[2]];
    status = dgfem_shelli_system_create(next);
    return status ? status : dgfem_shelli_renew_conditions(edit, next);
}

/* Separates the gaps, builds the new topology and puts it in the shell's place. *separated: edges that came apart. */
static dgfem_status dgfem_shelli_edit_commit(dgfem_shelli_edit *edit, dgfem_shell *shell, int *separated) {
    dgfem_shell next = *shell;
    *separated = dgfem_shelli_edit_separate(edit);
    if (*separated < 0) return DGFEM_ERROR_MEMORY;
    next.rest = next.position = next.velocity = NULL;
    next.node_area = next.node_mass = next.node_load = next.node_half = next.node_spring = NULL;
    next.elements = NULL;
    next.edges = NULL;
    next.system = NULL;
    next.conditions = NULL;
    next.condition_count = 0;
    dgfem_status status = dgfem_shelli_edit_build(edit, &next);
    if (status) {
        dgfem_shelli_free_topology(&next);
        dgfem_shelli_free_conditions(&next);
        return status;
    }
    dgfem_shelli_free_topology(shell);
    dgfem_shelli_free_conditions(shell);
    *shell = next;
    shell->revision++;
    dgfem_shelli_refresh_edges(shell);
    return DGFEM_OK;
}

/* ---- cuts along edges ---- */

DGFEM_API dgfem_status dgfem_shell_cut_edges(dgfem_shell *shell, const int *edges, int count, dgfem_shell_joint joint) {
    dgfem_shelli_edit edit;
    int separated, changed = 0;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_items(shell, edges, count, shell->edge_count, "edge");
    for (int i = 0; !status && i < count; i++)
        if (dgfem_shelli_is_boundary(&shell->edges[edges[i]]))
            status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "edge %d is on the boundary", edges[i]);
    if (!status && ((int)joint < 0 || joint > DGFEM_SHELL_GAP))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "unknown joint %d", (int)joint);
    for (int i = 0; !status && i < count; i++) changed += shell->edges[edges[i]].joint != joint;
    if (status || !changed) return status;
    status = dgfem_shelli_edit_begin(&edit, shell, shell->element_count, shell->node_count + 8 * shell->element_count);
    for (int i = 0; !status && i < count; i++) edit.joint[shell->edges[edges[i]].node[2]] = (char)joint;
    if (!status) status = dgfem_shelli_edit_commit(&edit, shell, &separated);
    dgfem_shelli_scratch_free(&edit.scratch);
    return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&shell->hooks) : status;
}

/* ---- pieces ---- */

/* class_of and number have room for all elements; number[root of class_of] becomes the piece. */
static int dgfem_shelli_count_pieces(const dgfem_shell *shell, int *class_of, int *number) {
    int count = 0;
    for (int e = 0; e < shell->element_count; e++) class_of[e] = e, number[e] = DGFEM_NONE;
    for (int i = 0; i < shell->edge_count; i++)
        if (!dgfem_shelli_is_boundary(&shell->edges[i]))
            class_of[dgfem_shelli_root(class_of, shell->edges[i].element[0])] =
                dgfem_shelli_root(class_of, shell->edges[i].element[1]);
    for (int e = 0; e < shell->element_count; e++) {
        int root = dgfem_shelli_root(class_of, e);
        if (number[root] == DGFEM_NONE) number[root] = count++;
    }
    return count;
}

DGFEM_API dgfem_status dgfem_shell_pieces(const dgfem_shell *shell, int *count, int *piece) {
    if (!shell || !count) return DGFEM_ERROR_ARGUMENT;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    int *class_of = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
    int *number = (int *)dgfem_shelli_take(&scratch, (size_t)shell->element_count, sizeof(int));
    if (!class_of || !number) {
        dgfem_shelli_scratch_free(&scratch);
        return dgfem_shelli_fail_memory(&shell->hooks);
    }
    *count = dgfem_shelli_count_pieces(shell, class_of, number);
    for (int e = 0; piece && e < shell->element_count; e++) piece[e] = number[dgfem_shelli_root(class_of, e)];
    dgfem_shelli_scratch_free(&scratch);
    return DGFEM_OK;
}

/* ==== split.c ===================================================================================================== */

/* Cuts across elements: triangles that follow a plane take the place of the elements that it crosses.

   Corners are below (-1), on (0) or above (1) the plane. Every run of corners below, between two points of the boundary
   on the plane (a corner that counts as on it, or a crossed side), is cut off by one chord:

        + ------- +            The sides' crossing points become corners, in place of the sides' middle nodes: so no
        |         |            node is left over. Each part is divided into triangles with the best worst angle.
        x . chord x            An element that is not cut itself, but whose side was crossed, is divided likewise.
        |  .    . |
        - --- - --             */

enum { DGFEM_SHELLI_MAX_POLYGON = 8 };

typedef struct dgfem_shelli_splitter {
    dgfem_shelli_edit *edit;
    const dgfem_shell_cut_desc *desc;
    dgfem_real *distance; /* [old nodes] of corners from the plane */
    signed char *side;    /* [old nodes] of corners */
    char *cut;            /* [old elements] whether the cut runs through */
    dgfem_real *crossing; /* [old edges] where a split edge is split, 0 < t < 1 from its start; 0: not split */
    int *half;            /* [2 * old edges] new middle nodes of a split edge */
    int elements_split;
} dgfem_shelli_splitter;

/* ---- where the plane runs ---- */

static dgfem_real dgfem_shelli_plane_distance(const dgfem_shelli_splitter *s, int node) {
    const dgfem_shell *shell = s->edit->old;
    const dgfem_vec3 *x = s->desc->current ? shell->position : shell->rest;
    return dgfem_shelli_dot(s->desc->plane.normal, x[node]) - s->desc->plane.offset;
}

/* Whether a point is between the planes that bound the cut. */
static int dgfem_shelli_in_bounds(const dgfem_shell_cut_desc *desc, dgfem_vec3 x) {
    dgfem_vec3 along = dgfem_shelli_sub(desc->to, desc->from);
    dgfem_real t = dgfem_shelli_dot(along, dgfem_shelli_sub(x, desc->from));
    return !desc->bounded || (t >= 0 && t <= dgfem_shelli_dot(along, along));
}

static void dgfem_shelli_classify(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    for (int i = 0; i < shell->node_count; i++) {
        s->distance[i] = dgfem_shelli_plane_distance(s, i);
        s->side[i] = (signed char)(s->distance[i] > 0 ? 1 : s->distance[i] < 0 ? -1 : 0);
    }
    for (int i = 0; i < shell->edge_count; i++) {
        int a = shell->edges[i].node[0], b = shell->edges[i].node[1];
        dgfem_real da = dgfem_shelli_abs(s->distance[a]), db = dgfem_shelli_abs(s->distance[b]);
        if (!((s->distance[a] < 0 && s->distance[b] > 0) || (s->distance[a] > 0 && s->distance[b] < 0))) continue;
        if (da <= s->desc->snap * (da + db)) s->side[a] = 0;
        if (db <= s->desc->snap * (da + db)) s->side[b] = 0;
    }
}

static int dgfem_shelli_is_crossed(const dgfem_shelli_splitter *s, int edge) {
    const int *node = s->edit->old->edges[edge].node;
    return s->side[node[0]] * s->side[node[1]] < 0;
}

/* Middle of the points where an element's boundary meets the plane. 0 where the plane does not run through it. */
static int dgfem_shelli_crosses(const dgfem_shelli_splitter *s, int e, dgfem_vec3 *middle) {
    const dgfem_shell *shell = s->edit->old;
    const dgfem_shell_element *element = &shell->elements[e];
    const dgfem_vec3 *x = s->desc->current ? shell->position : shell->rest;
    int corners = dgfem_shelli_corners(element), above = 0, below = 0, points = 0;
    *middle = dgfem_shelli_vec3(0, 0, 0);
    for (int k = 0; k < corners; k++) {
        int a = element->node[k], b = element->node[(k + 1) % corners];
        above += s->side[a] > 0;
        below += s->side[a] < 0;
        if (s->side[a] == 0) *middle = dgfem_shelli_add(*middle, x[a]), points++;
        if (s->side[a] * s->side[b] >= 0) continue;
        dgfem_real t = s->distance[a] / (s->distance[a] - s->distance[b]);
        *middle = dgfem_shelli_add(*middle, dgfem_shelli_axpy(x[a], t, dgfem_shelli_sub(x[b], x[a])));
        points++;
    }
    if (!above || !below) return 0;
    *middle = dgfem_shelli_scale(1 / (dgfem_real)points, *middle);
    return 1;
}

/* The root of the distance along a crossed edge, kept away from its ends. */
static dgfem_real dgfem_shelli_crossing(const dgfem_shelli_splitter *s, const int *node) {
    dgfem_real da = s->distance[node[0]], db = s->distance[node[1]], dm = s->distance[node[2]], low = 0, high = 1;
    dgfem_real margin = dgfem_shelli_max(DGFEM_R(0.5) * s->desc->snap, DGFEM_R(1e-3));
    for (int k = 0; k < 60; k++) {
        dgfem_real t = DGFEM_R(0.5) * (low + high);
        dgfem_real d = da * (1 - t) * (1 - 2 * t) + 4 * dm * t * (1 - t) + db * t * (2 * t - 1);
        if ((d > 0) == (da > 0)) low = t;
        else high = t;
    }
    return low < margin ? margin : low > 1 - margin ? 1 - margin : low;
}

/* ---- splitting edges ---- */

/* Puts a point of an old element at node `at` of the new topology, or at one more where that is DGFEM_NONE. Returns the
   node. */
static int dgfem_shelli_interpolate(dgfem_shelli_edit *edit, const dgfem_shell_element *element,
                                    dgfem_shelli_parameter p, int at) {
    const dgfem_shell *old = edit->old;
    dgfem_vec3 x[DGFEM_SHELL_MAX_NODES], rest, position, velocity;
    dgfem_shelli_basis f;
    int n = element->node_count;
    dgfem_shelli_basis_at(n, p, &f);
    dgfem_shelli_gather(old->rest, element->node, n, x);
    rest = dgfem_shelli_sum(f.n, x, n);
    dgfem_shelli_gather(old->position, element->node, n, x);
    position = dgfem_shelli_sum(f.n, x, n);
    dgfem_shelli_gather(old->velocity, element->node, n, x);
    velocity = dgfem_shelli_sum(f.n, x, n);
    if (at == DGFEM_NONE) return dgfem_shelli_edit_node(edit, rest, position, velocity);
    edit->rest[at] = rest, edit->position[at] = position, edit->velocity[at] = velocity;
    return at;
}

/* The middle node moves to the crossing and becomes a corner; two new ones are made. */
static void dgfem_shelli_split_edge(dgfem_shelli_splitter *s, int index) {
    dgfem_shelli_edit *edit = s->edit;
    const dgfem_shell_edge *edge = &edit->old->edges[index];
    const dgfem_shell_element *element = &edit->old->elements[edge->element[0]];
    dgfem_real t = s->crossing[index] = dgfem_shelli_crossing(s, edge->node);
    int n = element->node_count, side = edge->side[0];
    (void)dgfem_shelli_interpolate(edit, element, dgfem_shelli_side(n, side, 2 * t - 1), edge->node[2]);
    for (int k = 0; k < 2; k++) {
        int node = dgfem_shelli_interpolate(edit, element, dgfem_shelli_side(n, side, k ? t : t - 1), DGFEM_NONE);
        edit->edge_from[node] = edit->on_edge[node] = index;
        edit->joint[node] = (char)edge->joint;
        s->half[2 * index + k] = node;
    }
    edit->moved_to[edge->node[2]] = s->half[2 * index + (t < DGFEM_R(0.5))];
    edit->to_crossing[edge->node[2]] = 3 * t >= 1 && 3 * t <= 2; /* nearer than the middle of the part */
    edit->edge_from[edge->node[2]] = DGFEM_NONE;
    edit->joint[edge->node[2]] = DGFEM_SHELL_GLUED;
}

/* ---- dividing elements ---- */

typedef struct dgfem_shelli_polygon {
    int count;
    int node[DGFEM_SHELLI_MAX_POLYGON];
    dgfem_shelli_parameter at[DGFEM_SHELLI_MAX_POLYGON];
    int side[DGFEM_SHELLI_MAX_POLYGON];                             /* of the plane */
    int middle[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON]; /* of the line between two points, or DGFEM_NONE */
    dgfem_vec3 x[DGFEM_SHELLI_MAX_POLYGON];                         /* at rest */
} dgfem_shelli_polygon;

static void dgfem_shelli_polygon_push(dgfem_shelli_polygon *polygon, const dgfem_shelli_edit *edit, int node,
                                      dgfem_shelli_parameter at, int side) {
    int i = polygon->count++;
    polygon->node[i] = node;
    polygon->at[i] = at;
    polygon->side[i] = side;
    polygon->x[i] = edit->rest[node];
}

/* The element's boundary with its crossing points. */
static void dgfem_shelli_polygon_make(const dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                      dgfem_shelli_polygon *polygon) {
    const dgfem_shelli_edit *edit = s->edit;
    int n = element->node_count, corners = n / 2, middle[DGFEM_SHELLI_MAX_POLYGON];
    polygon->count = 0;
    for (int k = 0; k < corners; k++) {
        int index = element->edge[k], forward = edit->old->edges[index].element[0] == e;
        dgfem_real t = s->crossing[index];
        forward = forward && edit->old->edges[index].side[0] == k;
        middle[polygon->count] = element->node[corners + k];
        if (t > 0) middle[polygon->count] = s->half[2 * index + !forward];
        dgfem_shelli_polygon_push(polygon, edit, element->node[k], dgfem_shelli_corner(n, k),
                                  s->side[element->node[k]]);
        if (!(t > 0)) continue;
        middle[polygon->count] = s->half[2 * index + forward];
        dgfem_shelli_polygon_push(polygon, edit, element->node[corners + k],
                                  dgfem_shelli_side(n, k, forward ? 2 * t - 1 : 1 - 2 * t), 0);
    }
    for (int i = 0; i < polygon->count; i++)
        for (int j = 0; j < polygon->count; j++) polygon->middle[i][j] = DGFEM_NONE;
    for (int i = 0; i < polygon->count; i++) {
        int j = (i + 1) % polygon->count;
        polygon->middle[i][j] = polygon->middle[j][i] = middle[i];
    }
}

static int dgfem_shelli_polygon_middle(dgfem_shelli_splitter *s, const dgfem_shell_element *element,
                                       dgfem_shelli_polygon *polygon, int i, int j) {
    if (polygon->middle[i][j] == DGFEM_NONE) {
        dgfem_shelli_parameter p = polygon->at[i], q = polygon->at[j];
        p = dgfem_shelli_parameter_make((p.a + q.a) / 2, (p.b + q.b) / 2);
        polygon->middle[i][j] = polygon->middle[j][i] = dgfem_shelli_interpolate(s->edit, element, p, DGFEM_NONE);
    }
    return polygon->middle[i][j];
}

/* How bad a triangle is: longest side squared by area, large where it is flat in the parameters. */
static dgfem_real dgfem_shelli_badness(const dgfem_shelli_polygon *polygon, int i, int j, int k) {
    dgfem_shelli_parameter p = polygon->at[i], q = polygon->at[j], r = polygon->at[k];
    dgfem_vec3 a = dgfem_shelli_sub(polygon->x[j], polygon->x[i]), b = dgfem_shelli_sub(polygon->x[k], polygon->x[j]);
    dgfem_vec3 c = dgfem_shelli_sub(polygon->x[i], polygon->x[k]);
    dgfem_real flat = (q.a - p.a) * (r.b - p.b) - (q.b - p.b) * (r.a - p.a);
    dgfem_real longest =
        dgfem_shelli_max(dgfem_shelli_dot(a, a), dgfem_shelli_max(dgfem_shelli_dot(b, b), dgfem_shelli_dot(c, c)));
    dgfem_real area = dgfem_shelli_norm(dgfem_shelli_cross(a, b));
    if (!(flat > DGFEM_R(1e-5)) || !(area > DGFEM_R(1e-12) * longest)) return DGFEM_R(1e30);
    return longest / area;
}

static void dgfem_shelli_add_triangle(dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                      dgfem_shelli_polygon *polygon, int i, int j, int k, int *pieces) {
    dgfem_shelli_edit *edit = s->edit;
    int to = (*pieces)++ ? edit->element_count++ : e;
    dgfem_shell_element *piece = &edit->elements[to];
    DGFEM_ASSERT(edit->element_count <= edit->element_capacity);
    *piece = *element;
    piece->node_count = 6;
    piece->node[0] = polygon->node[i], piece->node[1] = polygon->node[j], piece->node[2] = polygon->node[k];
    piece->node[3] = dgfem_shelli_polygon_middle(s, element, polygon, i, j);
    piece->node[4] = dgfem_shelli_polygon_middle(s, element, polygon, j, k);
    piece->node[5] = dgfem_shelli_polygon_middle(s, element, polygon, k, i);
    edit->element_from[to] = e;
}

/* Triangles of a part of the polygon (indices, counter-clockwise), by the classical recursion over its sub-ranges:
   best[i][j] is the least possible worst triangle between points i and j. */
static void dgfem_shelli_triangulate(dgfem_shelli_splitter *s, const dgfem_shell_element *element, int e,
                                     dgfem_shelli_polygon *polygon, const int *part, int count, int *pieces) {
    dgfem_real best[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON] = {{0}};
    int apex[DGFEM_SHELLI_MAX_POLYGON][DGFEM_SHELLI_MAX_POLYGON] = {{0}};
    int stack[2 * DGFEM_SHELLI_MAX_POLYGON][2], top = 0;
    for (int span = 2; span < count; span++)
        for (int i = 0; i + span < count; i++) {
            int j = i + span;
            best[i][j] = DGFEM_R(1e35);
            for (int k = i + 1; k < j; k++) {
                dgfem_real worst = dgfem_shelli_badness(polygon, part[i], part[k], part[j]);
                worst = dgfem_shelli_max(worst, dgfem_shelli_max(best[i][k], best[k][j]));
                if (worst < best[i][j]) best[i][j] = worst, apex[i][j] = k;
            }
        }
    stack[top][0] = 0, stack[top++][1] = count - 1;
    while (top) {
        int i = stack[--top][0], j = stack[top][1], k = apex[i][j];
        if (j - i < 2) continue;
        dgfem_shelli_add_triangle(s, element, e, polygon, part[i], part[k], part[j], pieces);
        stack[top][0] = i, stack[top++][1] = k;
        stack[top][0] = k, stack[top++][1] = j;
    }
}

/* Cuts off every run below the plane, then divides what is left. */
static void dgfem_shelli_divide(dgfem_shelli_splitter *s, int e) {
    const dgfem_shell_element *element = &s->edit->old->elements[e];
    dgfem_shelli_polygon polygon;
    int left[DGFEM_SHELLI_MAX_POLYGON], count = 0, pieces = 0;
    dgfem_shelli_polygon_make(s, element, e, &polygon);
    int n = polygon.count;
    for (int i = 0; i < n; i++) {
        int part[DGFEM_SHELLI_MAX_POLYGON], size = 1;
        if (!s->cut[e] || polygon.side[i] != 0 || polygon.side[(i + 1) % n] >= 0) continue;
        part[0] = i;
        do part[size] = (i + size) % n;
        while (polygon.side[part[size++]] < 0);
        int joint_node = dgfem_shelli_polygon_middle(s, element, &polygon, part[0], part[size - 1]);
        s->edit->joint[joint_node] = (char)s->desc->joint;
        dgfem_shelli_triangulate(s, element, e, &polygon, part, size, &pieces);
    }
    for (int i = 0; i < n; i++)
        if (!s->cut[e] || polygon.side[i] >= 0) left[count++] = i;
    dgfem_shelli_triangulate(s, element, e, &polygon, left, count, &pieces);
    s->elements_split++;
}

/* ---- the cut ---- */

/* Mean distance of an element's corners: the side that it is on. */
static int dgfem_shelli_element_above(const dgfem_shelli_splitter *s, int e) {
    const dgfem_shell_element *element = &s->edit->old->elements[e];
    dgfem_real sum = 0;
    for (int k = 0; k < dgfem_shelli_corners(element); k++) sum += s->distance[element->node[k]];
    return sum > 0;
}

/* Whether an edge lies on the plane, between elements on either side of it. */
static int dgfem_shelli_lies_along(const dgfem_shelli_splitter *s, const dgfem_shell_edge *edge) {
    const dgfem_vec3 *x = s->desc->current ? s->edit->old->position : s->edit->old->rest;
    if (dgfem_shelli_is_boundary(edge) || s->side[edge->node[0]] || s->side[edge->node[1]]) return 0;
    if (!dgfem_shelli_in_bounds(s->desc, x[edge->node[2]])) return 0;
    return dgfem_shelli_element_above(s, edge->element[0]) != dgfem_shelli_element_above(s, edge->element[1]);
}

static void dgfem_shelli_cut_along(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    for (int i = 0; i < shell->edge_count; i++)
        if (dgfem_shelli_lies_along(s, &shell->edges[i]))
            s->edit->joint[shell->edges[i].node[2]] = (char)s->desc->joint;
}

/* Edges that cutting along would change. */
static int dgfem_shelli_count_along(const dgfem_shelli_splitter *s) {
    const dgfem_shell *shell = s->edit->old;
    int count = 0;
    for (int i = 0; i < shell->edge_count; i++)
        count += shell->edges[i].joint != s->desc->joint && dgfem_shelli_lies_along(s, &shell->edges[i]);
    return count;
}

/* Finds the elements that are cut and those that must be divided because a side was crossed. Returns how many. */
static int dgfem_shelli_mark_elements(dgfem_shelli_splitter *s, const dgfem_shell *shell, char *touched) {
    int count = 0;
    for (int e = 0; e < shell->element_count; e++) {
        dgfem_vec3 middle;
        s->cut[e] = (char)(dgfem_shelli_crosses(s, e, &middle) && dgfem_shelli_in_bounds(s->desc, middle));
        if (!s->cut[e]) continue;
        touched[e] = 1;
        for (int k = 0; k < dgfem_shelli_corners(&shell->elements[e]); k++) {
            int index = shell->elements[e].edge[k];
            if (!dgfem_shelli_is_crossed(s, index)) continue;
            s->crossing[index] = 1;
            for (int side = 0; side < 2; side++)
                if (shell->edges[index].element[side] != DGFEM_NONE) touched[shell->edges[index].element[side]] = 1;
        }
    }
    for (int e = 0; e < shell->element_count; e++) count += touched[e];
    return count;
}

static dgfem_status dgfem_shelli_cut_elements(dgfem_shelli_splitter *s, dgfem_shell *shell,
                                              dgfem_shelli_scratch *scratch, dgfem_shell_cut_info *info) {
    dgfem_shelli_edit *edit = s->edit;
    size_t nodes = (size_t)shell->node_count, elements = (size_t)shell->element_count,
           edges = (size_t)shell->edge_count;
    char *touched = (char *)dgfem_shelli_take(scratch, elements, 1);
    s->distance = (dgfem_real *)dgfem_shelli_take(scratch, nodes, sizeof(dgfem_real));
    s->side = (signed char *)dgfem_shelli_take(scratch, nodes, 1);
    s->cut = (char *)dgfem_shelli_take(scratch, elements, 1);
    s->crossing = (dgfem_real *)dgfem_shelli_take(scratch, edges, sizeof(dgfem_real));
    s->half = (int *)dgfem_shelli_take(scratch, 2 * edges, sizeof(int));
    if (!touched || !s->distance || !s->side || !s->cut || !s->crossing || !s->half) return DGFEM_ERROR_MEMORY;
    edit->old = shell;
    dgfem_shelli_classify(s);
    int count = dgfem_shelli_mark_elements(s, shell, touched);
    if (!count && !dgfem_shelli_count_along(s)) { /* nothing changes */
        int *class_of = (int *)dgfem_shelli_take(scratch, elements, sizeof(int));
        int *number = (int *)dgfem_shelli_take(scratch, elements, sizeof(int));
        if (!class_of || !number) return DGFEM_ERROR_MEMORY;
        info->pieces = dgfem_shelli_count_pieces(shell, class_of, number);
        return DGFEM_OK;
    }

    /* A divided element gives six triangles and five lines inside at most; two new middles per side. */
    int element_room = shell->element_count + 5 * count, node_room = shell->node_count + 13 * count + 6 * element_room;
    dgfem_status status = dgfem_shelli_edit_begin(edit, shell, element_room, node_room);
    if (status) return status;
    for (int i = 0; i < shell->edge_count; i++)
        if (s->crossing[i] > 0) dgfem_shelli_split_edge(s, i);
    for (int e = 0; e < shell->element_count; e++)
        if (touched[e]) dgfem_shelli_divide(s, e);
    dgfem_shelli_cut_along(s);
    int *class_of = (int *)dgfem_shelli_take(scratch, (size_t)edit->element_count, sizeof(int));
    int *number = (int *)dgfem_shelli_take(scratch, (size_t)edit->element_count, sizeof(int));
    if (!class_of || !number) return DGFEM_ERROR_MEMORY;
    status = dgfem_shelli_edit_commit(edit, shell, &info->edges_cut);
    if (!status) info->pieces = dgfem_shelli_count_pieces(shell, class_of, number);
    info->elements_split = s->elements_split;
    return status;
}

static dgfem_status dgfem_shelli_check_cut(const dgfem_shell *shell, const dgfem_shell_cut_desc *desc) {
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_shelli_check_vector(shell, desc->plane.normal, "normal");
    if (!status) status = dgfem_shelli_check_real(shell, desc->plane.offset, "offset");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->from, "from");
    if (!status) status = dgfem_shelli_check_vector(shell, desc->to, "to");
    if (!status && !(dgfem_shelli_norm(desc->plane.normal) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "the normal is zero");
    if (!status && desc->bounded && !(dgfem_shelli_norm(dgfem_shelli_sub(desc->to, desc->from)) > 0))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "a bounded cut from a point to itself");
    if (!status && !(desc->snap >= 0 && desc->snap < DGFEM_R(0.5)))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "snap is %g, expected in [0, 0.5)",
                                   (double)desc->snap);
    if (!status && ((int)desc->joint < 0 || desc->joint > DGFEM_SHELL_GAP))
        status = dgfem_shelli_fail(&shell->hooks, DGFEM_ERROR_ARGUMENT, "unknown joint %d", (int)desc->joint);
    return status;
}

DGFEM_API dgfem_status dgfem_shell_cut_plane(dgfem_shell *shell, const dgfem_shell_cut_desc *desc,
                                             dgfem_shell_cut_info *info) {
    dgfem_shell_cut_info local;
    dgfem_shelli_splitter splitter;
    dgfem_shelli_edit edit;
    if (!shell) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_shelli_check_cut(shell, desc);
    if (status) return status;
    memset(&local, 0, sizeof local);
    memset(&splitter, 0, sizeof splitter);
    memset(&edit, 0, sizeof edit);
    splitter.edit = &edit;
    splitter.desc = desc;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(&shell->hooks);
    local.nodes_added = -shell->node_count;
    status = dgfem_shelli_cut_elements(&splitter, shell, &scratch, &local);
    dgfem_shelli_scratch_free(&edit.scratch);
    dgfem_shelli_scratch_free(&scratch);
    if (status) return status == DGFEM_ERROR_MEMORY ? dgfem_shelli_fail_memory(&shell->hooks) : status;
    local.nodes_added += shell->node_count;
    if (info) *info = local;
    return DGFEM_OK;
}

/* ==== surface.c =================================================================================================== */

/* Render surface: the curved elements evaluated on a lattice of parameters, with their exact normals, as one or two
   sheets of triangles, closed by rims along the boundary.

   Points on sides are shared by the elements that meet there, corners by all around them. The lattice of a
   quadrilateral has (m + 1)^2 points, row by row; row j of a triangle's has m + 1 - j. */

DGFEM_API dgfem_shell_surface_desc dgfem_default_shell_surface_desc(void) {
    dgfem_shell_surface_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_SHELL_COOKIE;
    desc.subdivision = 2;
    desc.sides = 2;
    return desc;
}

static int dgfem_shelli_row_length(int nodes, int m, int j) { return nodes == 8 ? m + 1 : m + 1 - j; }

/* First point of row j. */
static int dgfem_shelli_row_start(int nodes, int m, int j) {
    return nodes == 8 ? (m + 1) * j : (m + 1) * j - j * (j - 1) / 2;
}
static int dgfem_shelli_lattice_size(int nodes, int m) {
    return dgfem_shelli_row_start(nodes, m, m) + dgfem_shelli_row_length(nodes, m, m);
}

static dgfem_shelli_parameter dgfem_shelli_lattice_at(int nodes, int m, int i, int j) {
    dgfem_real a = (dgfem_real)i / (dgfem_real)m, b = (dgfem_real)j / (dgfem_real)m;
    return nodes == 8 ? dgfem_shelli_parameter_make(2 * a - 1, 2 * b - 1) : dgfem_shelli_parameter_make(a, b);
}

/* Where step k = 0 .. m of a side, in the element's own direction, stands in its lattice. */
static int dgfem_shelli_lattice_side(int nodes, int m, int side, int k) {
    int i = side == 0 ? k : side == 1 ? m : m - k, j = side == 0 ? 0 : side == 1 ? k : m;
    if (nodes == 8 && side == 3) i = 0, j = m - k;
    if (nodes == 6 && side == 1) i = m - k, j = k;
    if (nodes == 6 && side == 2) i = 0, j = m - k;
    return dgfem_shelli_row_start(nodes, m, j) + i;
}

/* ---- creation ---- */

/* Numbers all points: corners by node, then the inner points of sides by edge, then the rest. */
static int dgfem_shelli_number_points(dgfem_shell_surface *surface, const dgfem_shell *shell, int *corner) {
    int m = surface->subdivision, next = 0;
    for (int i = 0; i < shell->node_count; i++) corner[i] = DGFEM_NONE;
    for (int e = 0; e < shell->element_count; e++)
        for (int k = 0; k < dgfem_shelli_corners(&shell->elements[e]); k++)
            if (corner[shell->elements[e].node[k]] == DGFEM_NONE) corner[shell->elements[e].node[k]] = next++;
    int first = next;
    next += shell->edge_count * (m - 1);
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        int n = element->node_count, *point = surface->point_of + surface->point_start[e];
        for (int i = 0; i < dgfem_shelli_lattice_size(n, m); i++) point[i] = DGFEM_NONE;
        for (int side = 0; side < n / 2; side++) {
            const dgfem_shell_edge *edge = &shell->edges[element->edge[side]];
            int forward = edge->element[0] == e && edge->side[0] == side;
            point[dgfem_shelli_lattice_side(n, m, side, 0)] = corner[element->node[side]];
            for (int k = 1; k < m; k++)
                point[dgfem_shelli_lattice_side(n, m, side, k)] =
                    first + element->edge[side] * (m - 1) + (forward ? k : m - k) - 1;
        }
        for (int i = 0; i < dgfem_shelli_lattice_size(n, m); i++)
            if (point[i] == DGFEM_NONE) point[i] = next++;
    }
    return next;
}

static void dgfem_shelli_add_face(dgfem_shell_surface *surface, int e, int a, int b, int c) {
    int sheets = surface->sides, offset = surface->point_count;
    for (int sheet = 0; sheet < sheets; sheet++) {
        int *t = surface->triangles + 3 * surface->triangle_count;
        t[0] = a + sheet * offset, t[1] = (sheet ? c : b) + sheet * offset, t[2] = (sheet ? b : c) + sheet * offset;
        surface->triangle_element[surface->triangle_count++] = e;
    }
}

static void dgfem_shelli_add_faces(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    int m = surface->subdivision;
    for (int e = 0; e < shell->element_count; e++) {
        int n = shell->elements[e].node_count;
        const int *point = surface->point_of + surface->point_start[e];
        for (int j = 0; j < m; j++) {
            const int *row = point + dgfem_shelli_row_start(n, m, j),
                      *next = point + dgfem_shelli_row_start(n, m, j + 1);
            int length = dgfem_shelli_row_length(n, m, j);
            for (int i = 0; i + 1 < length; i++) {
                if (n == 8) {
                    dgfem_shelli_add_face(surface, e, row[i], row[i + 1], next[i + 1]);
                    dgfem_shelli_add_face(surface, e, row[i], next[i + 1], next[i]);
                } else {
                    dgfem_shelli_add_face(surface, e, row[i], row[i + 1], next[i]);
                    if (i + 2 < length) dgfem_shelli_add_face(surface, e, row[i + 1], next[i + 1], next[i]);
                }
            }
        }
    }
}

/* A strip from the upper to the lower sheet along every boundary edge. */
static void dgfem_shelli_add_rims(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    int m = surface->subdivision, offset = surface->point_count;
    for (int i = 0; surface->sides == 2 && i < shell->edge_count; i++) {
        const dgfem_shell_edge *edge = &shell->edges[i];
        int e = edge->element[0], n = shell->elements[e].node_count;
        const int *point = surface->point_of + surface->point_start[e];
        if (!dgfem_shelli_is_boundary(edge)) continue;
        for (int k = 0; k < m; k++) {
            int a = point[dgfem_shelli_lattice_side(n, m, edge->side[0], k)];
            int b = point[dgfem_shelli_lattice_side(n, m, edge->side[0], k + 1)];
            int *t = surface->triangles + 3 * surface->triangle_count;
            t[0] = a, t[1] = a + offset, t[2] = b + offset;
            t[3] = a, t[4] = b + offset, t[5] = b;
            surface->triangle_element[surface->triangle_count++] = e;
            surface->triangle_element[surface->triangle_count++] = e;
        }
    }
}

/* Whether the numbers of triangles' corners and of lattice points, on all sheets, are ints. */
static int dgfem_shelli_surface_fits(const dgfem_shell *shell, const dgfem_shell_surface_desc *desc) {
    const size_t sheets = (size_t)desc->sides, m = (size_t)desc->subdivision, limit = INT_MAX;
    size_t points = 0, corners = 0;
    for (int e = 0; e < shell->element_count; e++) {
        int nodes = shell->elements[e].node_count;
        points += sheets * (size_t)dgfem_shelli_lattice_size(nodes, desc->subdivision);
        corners += 3 * sheets * m * m * (nodes == 8 ? 2 : 1) + 6 * m * (size_t)nodes / 2;
        if (points > limit || corners > limit) return 0;
    }
    return 1;
}

static int dgfem_shelli_surface_build(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    const dgfem_hooks *hooks = &surface->hooks;
    dgfem_shelli_scratch scratch = dgfem_shelli_scratch_make(hooks);
    size_t m = (size_t)surface->subdivision, triangles = 0;
    int *corner = (int *)dgfem_shelli_take(&scratch, (size_t)shell->node_count, sizeof(int)), points = 0;
    surface->point_start = (int *)dgfem_shelli_allocate(hooks, (size_t)shell->element_count + 1, sizeof(int));
    for (int e = 0; surface->point_start && e < shell->element_count; e++) {
        surface->point_start[e] = points;
        points += dgfem_shelli_lattice_size(shell->elements[e].node_count, (int)m);
        triangles += m * m * (shell->elements[e].node_count == 8 ? 2 : 1) * (size_t)surface->sides;
    }
    for (int i = 0; i < shell->edge_count; i++) triangles += dgfem_shelli_is_boundary(&shell->edges[i]) ? 2 * m : 0;
    surface->point_of = (int *)dgfem_shelli_allocate(hooks, (size_t)points, sizeof(int));
    surface->triangles = (int *)dgfem_shelli_allocate(hooks, 3 * triangles, sizeof(int));
    surface->triangle_element = (int *)dgfem_shelli_allocate(hooks, triangles, sizeof(int));
    int made = corner && surface->point_start && surface->point_of && surface->triangles && surface->triangle_element;
    if (made) {
        surface->point_start[shell->element_count] = points;
        surface->point_count = dgfem_shelli_number_points(surface, shell, corner);
        surface->vertex_count = surface->point_count * surface->sides;
        dgfem_shelli_add_faces(surface, shell);
        dgfem_shelli_add_rims(surface, shell);
        size_t vertices = (size_t)surface->vertex_count;
        surface->positions = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, vertices, sizeof(dgfem_vec3));
        surface->normals = (dgfem_vec3 *)dgfem_shelli_allocate(hooks, vertices, sizeof(dgfem_vec3));
        surface->half = (dgfem_real *)dgfem_shelli_allocate(hooks, (size_t)surface->point_count, sizeof(dgfem_real));
        made = surface->positions && surface->normals && surface->half;
    }
    for (int e = 0; made && e < shell->element_count; e++)
        for (int i = surface->point_start[e]; i < surface->point_start[e + 1]; i++) {
            dgfem_real *half = &surface->half[surface->point_of[i]];
            *half = dgfem_shelli_max(*half, shell->elements[e].thickness / 2);
        }
    dgfem_shelli_scratch_free(&scratch);
    return made;
}

DGFEM_API dgfem_status dgfem_shell_surface_create(const dgfem_shell *shell, const dgfem_shell_surface_desc *desc,
                                                  dgfem_shell_surface **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_SHELL_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (!shell) return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "surface: no shell");
    if (desc->subdivision < 1 || desc->subdivision > 64 || desc->sides < 1 || desc->sides > 2)
        return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT, "surface: subdivision %d, sides %d",
                                 desc->subdivision, desc->sides);
    if (!dgfem_shelli_surface_fits(shell, desc))
        return dgfem_shelli_fail(&desc->hooks, DGFEM_ERROR_ARGUMENT,
                                 "surface: %d elements with subdivision %d give more triangles than an int can count",
                                 shell->element_count, desc->subdivision);
    dgfem_shell_surface *surface = (dgfem_shell_surface *)dgfem_shelli_allocate(&desc->hooks, 1, sizeof *surface);
    if (!surface) return dgfem_shelli_fail_memory(&desc->hooks);
    surface->hooks = desc->hooks;
    surface->subdivision = desc->subdivision;
    surface->sides = desc->sides;
    surface->revision = shell->revision;
    surface->element_count = shell->element_count;
    surface->node_count = shell->node_count;
    if (!dgfem_shelli_surface_build(surface, shell)) {
        dgfem_shell_surface_destroy(surface);
        return dgfem_shelli_fail_memory(&desc->hooks);
    }
    *out = surface;
    return dgfem_shell_surface_update(surface, shell);
}

DGFEM_API void dgfem_shell_surface_destroy(dgfem_shell_surface *surface) {
    if (!surface) return;
    dgfem_hooks hooks = surface->hooks;
    dgfem_shelli_free(&hooks, surface->positions);
    dgfem_shelli_free(&hooks, surface->normals);
    dgfem_shelli_free(&hooks, surface->triangles);
    dgfem_shelli_free(&hooks, surface->triangle_element);
    dgfem_shelli_free(&hooks, surface->point_of);
    dgfem_shelli_free(&hooks, surface->point_start);
    dgfem_shelli_free(&hooks, surface->half);
    dgfem_shelli_free(&hooks, surface);
}

/* ---- update ---- */

/* Positions and summed normals of one lattice point in all elements of a kind. */
static void dgfem_shelli_surface_point(dgfem_shell_surface *surface, const dgfem_shell *shell, int nodes, int index,
                                       dgfem_shelli_parameter p) {
    dgfem_shelli_basis f;
    dgfem_shelli_basis_at(nodes, p, &f);
    for (int e = 0; e < shell->element_count; e++) {
        const dgfem_shell_element *element = &shell->elements[e];
        dgfem_vec3 x[DGFEM_SHELL_MAX_NODES];
        if (element->node_count != nodes) continue;
        int point = surface->point_of[surface->point_start[e] + index];
        dgfem_shelli_gather(shell->position, element->node, nodes, x);
        surface->positions[point] = dgfem_shelli_sum(f.n, x, nodes);
        dgfem_vec3 normal = dgfem_shelli_cross(dgfem_shelli_sum(f.d1, x, nodes), dgfem_shelli_sum(f.d2, x, nodes));
        surface->normals[point] = dgfem_shelli_add(surface->normals[point], dgfem_shelli_unit(normal));
    }
}

DGFEM_API dgfem_status dgfem_shell_surface_update(dgfem_shell_surface *surface, const dgfem_shell *shell) {
    if (!surface || !shell) return DGFEM_ERROR_ARGUMENT;
    if (surface->revision != shell->revision)
        return dgfem_shelli_fail(&surface->hooks, DGFEM_ERROR_REVISION, "surface of revision %d, shell has %d",
                                 surface->revision, shell->revision);
    if (surface->element_count != shell->element_count || surface->node_count != shell->node_count)
        return dgfem_shelli_fail(&surface->hooks, DGFEM_ERROR_REVISION,
                                 "surface of %d elements and %d nodes, shell has %d and %d", surface->element_count,
                                 surface->node_count, shell->element_count, shell->node_count);
    int m = surface->subdivision, count = surface->point_count;
    memset(surface->normals, 0, (size_t)count * sizeof *surface->normals);
    for (int nodes = 6; nodes <= 8; nodes += 2)
        for (int j = 0; j <= m; j++)
            for (int i = 0; i < dgfem_shelli_row_length(nodes, m, j); i++)
                dgfem_shelli_surface_point(surface, shell, nodes, dgfem_shelli_row_start(nodes, m, j) + i,
                                           dgfem_shelli_lattice_at(nodes, m, i, j));
    for (int i = 0; i < count; i++) {
        dgfem_vec3 x = surface->positions[i], normal = dgfem_shelli_unit(surface->normals[i]);
        surface->normals[i] = normal;
        if (surface->sides == 1) continue;
        surface->positions[i] = dgfem_shelli_axpy(x, surface->half[i], normal);
        surface->positions[count + i] = dgfem_shelli_axpy(x, -surface->half[i], normal);
        surface->normals[count + i] = dgfem_shelli_scale(-1, normal);
    }
    return DGFEM_OK;
}

#endif /* DGFEM_IMPLEMENTATION */

/* Copyright (c) the dgfem authors

   Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated
   documentation files (the "Software"), to deal in the Software without restriction, including without limitation the
   rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to
   permit persons to whom the Software is furnished to do so, subject to the following conditions:

   The above copyright notice and this permission notice shall be included in all copies or substantial portions of the
   Software.

   THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE
   WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR
   COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR
   OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE. */

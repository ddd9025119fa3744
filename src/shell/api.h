#pragma once
#include "dgfem.h"
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

#pragma once
#include "dgfem.h"
/* Public types and declarations of finite elements on polyhedra. */

/* Objects made with one precision must not reach code compiled for the other; see dgfem.h. */
#if DGFEM_REAL_IS_FLOAT
#define dgfem_mvc_create dgfem_mvc_create_float
#define dgfem_mvc_skin_create dgfem_mvc_skin_create_float
#define dgfem_mvc_surface_create dgfem_mvc_surface_create_float
#endif

/* ---- mean value coordinates ---------------------------------------------------------------------------------- */

/* A polyhedron with triangulated faces, that need not be planar: all arrays are the caller's. */
typedef struct dgfem_mvc_cell {
    const dgfem_vec3 *nodes; /* [node_count] */
    int node_count;          /* at least 4 */
    const int *triangles;    /* three indices of nodes each, counter-clockwise from outside; a closed surface */
    int triangle_count;
} dgfem_mvc_cell;

/* Mean value coordinates of x: values[node_count], with sum values = 1 and sum values * nodes = x, positive where x
   sees all triangles from inside; linear on triangles. gradients[node_count] may be NULL; on the surface of the cell
   itself there are none (DGFEM_ERROR_DEGENERATE). Outside, values are a smooth extension, of both signs. Errors of
   values stay near round-off everywhere, those of gradients grow as size / distance from the surface. Refuses indices
   out of range, fewer than four nodes or triangles, numbers that are not finite. */
DGFEM_API dgfem_status dgfem_mvc_coordinates(const dgfem_mvc_cell *cell, dgfem_vec3 x, dgfem_real *values,
                                             dgfem_vec3 *gradients);

/* ---- body ---------------------------------------------------------------------------------------------------- */

/* How elements are integrated. The corrected rules add a constant to each node's gradients, so that their mean over the
   element is exact: without, linear fields are not reproduced (the patch test fails). */
typedef enum dgfem_mvc_quadrature {
    DGFEM_MVC_TET4,     /* four points in the tetrahedron over each triangle; corrected */
    DGFEM_MVC_PAPER,    /* one point near each node and one near each triangle, eq. (14)-(16); corrected; cheap */
    DGFEM_MVC_PAPER_RAW /* the same without correction, as published */
} dgfem_mvc_quadrature;

typedef struct dgfem_mvc_desc {
    unsigned cookie;
    const dgfem_mesh *mesh;          /* of star-shaped elements whose faces have one loop; it is copied */
    dgfem_material material;         /* default 1e6 Pa, 0.3, 1000 kg/m^3 */
    const dgfem_material *materials; /* [elements] or NULL: `material` everywhere */
    dgfem_mvc_quadrature quadrature; /* default TET4 */
    dgfem_real stabilisation;        /* alpha: stiffness alpha mu h of motions beyond linear ones, for elements with
                                        very short edges; default 0, helpful 0.1 */
    int b_bar;                       /* 1: volume change as its mean in each element, against locking of nearly
                                        incompressible materials; default 0 */
    dgfem_vec3 gravity;              /* default 0 0 -9.81 m/s^2 */
    dgfem_real damping_mass;         /* Rayleigh alpha, 1/s; default 0 */
    dgfem_real damping_stiffness;    /* Rayleigh beta, s; default 0 */
    int warp;                        /* 1: stiffness warping (default); 0: linear elasticity */
    dgfem_solver solver;             /* DGFEM_SOLVER_CHOLESKY (default) or DGFEM_SOLVER_PCG; others are refused */
    dgfem_real solver_tolerance;     /* of PCG; default 1e-6 (float: 1e-4) */
    int solver_iterations;           /* of PCG at most; default 1000 */
    dgfem_hooks hooks;
} dgfem_mvc_desc;

/* Axes of dgfem_mvc_fix_nodes, to be added up. */
#define DGFEM_MVC_X 1
#define DGFEM_MVC_Y 2
#define DGFEM_MVC_Z 4
#define DGFEM_MVC_XYZ 7

/* What holds or loads a body. Each condition has an id, under which it is moved or removed. Cuts keep it where it is:
   copies of a node, and nodes between two that have it, have it as well, parts of a face theirs. */
typedef enum dgfem_mvc_condition_kind {
    DGFEM_MVC_CONDITION_FIX,      /* nodes: displacement given along some of the axes */
    DGFEM_MVC_CONDITION_PIN,      /* a spring from each node to a place of its own */
    DGFEM_MVC_CONDITION_TRACTION, /* force per rest area on boundary faces */
    DGFEM_MVC_CONDITION_PRESSURE, /* force per current area on boundary faces, along the inward normal */
    DGFEM_MVC_CONDITION_FORCE     /* force shared by nodes in proportion to `share` */
} dgfem_mvc_condition_kind;

typedef struct dgfem_mvc_condition {
    int id;
    dgfem_mvc_condition_kind kind;
    int count;                /* of items */
    int *items;               /* nodes or faces, as the kind says */
    dgfem_real *share;        /* FORCE, PIN: [count] part of the force or spring that each node has; else NULL */
    int axes;                 /* FIX */
    dgfem_mat3 linear;        /* FIX: the displacement is linear * rest + vector, */
    dgfem_vec3 vector;        /*   traction, force; PIN: place */
    dgfem_real scalar;        /* pressure; stiffness */
    dgfem_displacement_fn fn; /* FIX: NULL, or asked for the displacement instead */
    void *fn_user;
} dgfem_mvc_condition;

struct dgfem_mvci_mesh;                           /* nodes, faces and elements, private */
typedef struct dgfem_mvc_system dgfem_mvc_system; /* precomputed integrals and the solver, private */

/* State of a body. Read freely; change only through functions. Nodes are the corners of the mesh (dgfem_mesh_corners):
   at first in their order, then cuts renumber them, and raise the revision. */
typedef struct dgfem_mvc {
    dgfem_mvc_desc desc;
    int revision; /* grows with every change of topology */
    int node_count, face_count, element_count;
    dgfem_vec3 *rest;         /* [node_count] */
    dgfem_vec3 *position;     /* [node_count] */
    dgfem_vec3 *velocity;     /* [node_count] */
    dgfem_real *mass;         /* [node_count] lumped; sums to the mass */
    dgfem_real *area;         /* [node_count] what each node has of the boundary's rest area; for contact */
    dgfem_real *modulus;      /* [node_count] mean of E / radius of the node's elements (Pa/m); for contact */
    dgfem_material *material; /* [element_count] */
    int *tag;                 /* [element_count] tag of the element in desc.mesh; pieces inherit it */
    dgfem_real *volume;       /* [element_count] at rest */
    dgfem_vec3 *centre;       /* [element_count] volume centroid at rest */
    dgfem_mat3 *rotation;     /* [element_count] from rest, as of the last step, solve or dgfem_mvc_set_positions */
    struct dgfem_mvci_mesh *mesh;
    dgfem_mvc_system *system;
    int condition_count, condition_capacity, next_id;
    dgfem_mvc_condition *conditions;
    int shape_count, shape_capacity;
    dgfem_shape *shapes;
    double time; /* sum of the steps */
    dgfem_hooks hooks;
} dgfem_mvc;

typedef struct dgfem_mvc_info {
    int iterations;      /* of PCG; 0 with Cholesky */
    int sweeps;          /* static solve: solves with new rotations */
    int contacts;        /* nodes that touched a shape */
    int failed_node;     /* whose pivot was not positive, or DGFEM_NONE */
    dgfem_real residual; /* of PCG; static solve: last relative change of the displacement */
    double seconds_assemble, seconds_contact, seconds_factor, seconds_solve; /* 0 without a clock */
} dgfem_mvc_info;

typedef struct dgfem_mvc_static_desc {
    unsigned cookie;
    int load_steps;       /* loads and prescribed displacements grow in equal steps from none; default 1 */
    int max_sweeps;       /* per load step; default 60 */
    dgfem_real tolerance; /* on the change of the displacement relative to its size; default 1e-9 (float: 1e-4) */
} dgfem_mvc_static_desc;

DGFEM_API dgfem_mvc_desc dgfem_default_mvc_desc(void);
DGFEM_API dgfem_mvc_static_desc dgfem_default_mvc_static_desc(void);

/* Element e is element e of the mesh, face f its face f; a face that is cut becomes two, the second (of element[1])
   appended. Refuses faces of several loops, and elements that are not star-shaped about their centroid: each triangle
   of their faces must see it from inside. */
DGFEM_API dgfem_status dgfem_mvc_create(const dgfem_mvc_desc *desc, dgfem_mvc **out);
DGFEM_API void dgfem_mvc_destroy(dgfem_mvc *body);

/* Every invariant of nodes, faces and elements: within an element each directed edge once and its opposite once, faces
   with one or two owners, one and the same triangulation for both, positive volumes, no flat triangle. */
DGFEM_API dgfem_status dgfem_mvc_check(const dgfem_mvc *body);

/* ---- mesh of a body: questions, answered with the number there are; at most `capacity` are written ---- */

/* Nodes of a face, hanging ones included, counter-clockwise seen from outside of its first element; triangles (three
   nodes each) that it consists of; nodes and faces of an element. 0 where there is no such face or element. */
DGFEM_API int dgfem_mvc_face_nodes(const dgfem_mvc *body, int face, int *nodes, int capacity);
DGFEM_API int dgfem_mvc_face_triangles(const dgfem_mvc *body, int face, int *triangles, int capacity);
DGFEM_API int dgfem_mvc_element_nodes(const dgfem_mvc *body, int element, int *nodes, int capacity);
DGFEM_API int dgfem_mvc_element_faces(const dgfem_mvc *body, int element, int *faces, int capacity);
/* The elements of a face; the second is DGFEM_NONE on the boundary. Both are where there is no such face. */
DGFEM_API void dgfem_mvc_face_elements(const dgfem_mvc *body, int face, int elements[2]);
/* 1 where a face came to the boundary by a cut. */
DGFEM_API int dgfem_mvc_face_is_wall(const dgfem_mvc *body, int face);

/* All boundary faces whose nodes, or all nodes that, lie within `tolerance` of the plane (unit normal) at rest. */
DGFEM_API int dgfem_mvc_faces_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                       int capacity);
DGFEM_API int dgfem_mvc_nodes_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                       int capacity);
/* All nodes on the boundary. */
DGFEM_API int dgfem_mvc_boundary_nodes(const dgfem_mvc *body, int *nodes, int capacity);
/* The node whose current position is the nearest to x. */
DGFEM_API int dgfem_mvc_nearest_node(const dgfem_mvc *body, dgfem_vec3 x);

/* ---- conditions: *id (may be NULL) names the new one ---- */

/* Gives the displacement of nodes from rest along the axes (DGFEM_MVC_X + ...), exactly. Where several conditions hold
   the same axis of a node, the last one counts. */
DGFEM_API dgfem_status dgfem_mvc_fix_nodes(dgfem_mvc *body, const int *nodes, int count, int axes,
                                           dgfem_vec3 displacement, int *id);
/* The same by a function of the rest position, asked in every step and solve. */
DGFEM_API dgfem_status dgfem_mvc_fix_nodes_fn(dgfem_mvc *body, const int *nodes, int count, int axes,
                                              dgfem_displacement_fn fn, void *user, int *id);
/* The displacement becomes linear * rest + translation, at the end of the next step or solve. */
DGFEM_API dgfem_status dgfem_mvc_move_fixture(dgfem_mvc *body, int id, dgfem_mat3 linear, dgfem_vec3 translation);

/* A spring (N/m) that pulls a node to where it is now; drag moves the place. */
DGFEM_API dgfem_status dgfem_mvc_pin(dgfem_mvc *body, int node, dgfem_real stiffness, int *id);
DGFEM_API dgfem_status dgfem_mvc_drag(dgfem_mvc *body, int id, dgfem_vec3 place);

/* Traction (N/m^2 of rest area); pressure (N/m^2 of current area, positive pushes inward); force (N) on each of the
   nodes. A load on a face, once a cut has copied it, stays with the parts of the face. */
DGFEM_API dgfem_status dgfem_mvc_set_traction(dgfem_mvc *body, const int *faces, int count, dgfem_vec3 traction,
                                              int *id);
DGFEM_API dgfem_status dgfem_mvc_set_pressure(dgfem_mvc *body, const int *faces, int count, dgfem_real pressure,
                                              int *id);
DGFEM_API dgfem_status dgfem_mvc_add_force(dgfem_mvc *body, const int *nodes, int count, dgfem_vec3 force, int *id);
/* Changes the vector (traction, force) or scalar (pressure) of a load. */
DGFEM_API dgfem_status dgfem_mvc_change_load(dgfem_mvc *body, int id, dgfem_vec3 vector, dgfem_real scalar);
DGFEM_API dgfem_status dgfem_mvc_set_gravity(dgfem_mvc *body, dgfem_vec3 gravity);
DGFEM_API dgfem_status dgfem_mvc_remove_condition(dgfem_mvc *body, int id);

/* Contact shapes; *id (may be NULL) names it for dgfem_mvc_move_shape. Every boundary node keeps off the shape. */
DGFEM_API dgfem_status dgfem_mvc_add_plane(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_mvc_add_sphere(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id);
DGFEM_API dgfem_status dgfem_mvc_move_shape(dgfem_mvc *body, int id, const dgfem_shape_desc *desc);

/* ---- motion ---- */

/* One step of semi-implicit Euler: (M + h D + h^2 K) v+ = M v + h (F - f(x)), x+ = x + h v+, with the elements'
   rotations at its beginning. Nothing is allocated, except by the first step or solve after a cut, which makes the
   matrix and its solver anew. On failure nothing has changed. info may be NULL. */
DGFEM_API dgfem_status dgfem_mvc_step(dgfem_mvc *body, dgfem_real dt, dgfem_mvc_info *info);

/* Static equilibrium, from the current state, of loads, fixtures and pins (contact takes no part). Velocities become
   zero. On failure nothing has changed. DGFEM_ERROR_UNCONSTRAINED where the conditions leave a piece of the body free
   to move or turn as a rigid one. desc (NULL: the default) and info may be NULL. */
DGFEM_API dgfem_status dgfem_mvc_solve_static(dgfem_mvc *body, const dgfem_mvc_static_desc *desc, dgfem_mvc_info *info);

/* ---- state ---- */

/* Puts all nodes; fixtures take effect with the next step or solve. */
DGFEM_API dgfem_status dgfem_mvc_set_positions(dgfem_mvc *body, dgfem_points_in positions);
DGFEM_API dgfem_status dgfem_mvc_set_velocities(dgfem_mvc *body, dgfem_points_in velocities);

/* Strain, and Cauchy stress (Pa), of an element, means over its volume, in world axes; taken in the element's frame at
   the current positions, so that rigid motion gives none. */
DGFEM_API dgfem_status dgfem_mvc_strain(const dgfem_mvc *body, int element, dgfem_mat3 *out);
DGFEM_API dgfem_status dgfem_mvc_stress(const dgfem_mvc *body, int element, dgfem_mat3 *out);

/* Internal elastic force on every node (what static equilibrium balances) at the current positions, and external force:
   gravity and loads, without contact and pins; out[node_count]. */
DGFEM_API dgfem_status dgfem_mvc_internal_force(const dgfem_mvc *body, dgfem_vec3 *out);
DGFEM_API dgfem_status dgfem_mvc_external_force(const dgfem_mvc *body, dgfem_vec3 *out);

/* Stiffness of an element at rest, row-major, symmetric: out[9 k^2] for k nodes in the order of
   dgfem_mvc_element_nodes. */
DGFEM_API dgfem_status dgfem_mvc_element_stiffness(const dgfem_mvc *body, int element, dgfem_real *out);

DGFEM_API dgfem_status dgfem_mvc_energy(const dgfem_mvc *body, dgfem_energy *out);
/* Linear momentum, and angular momentum about the world's origin; either may be NULL. */
DGFEM_API dgfem_status dgfem_mvc_momentum(const dgfem_mvc *body, dgfem_vec3 *linear, dgfem_vec3 *angular);
DGFEM_API dgfem_real dgfem_mvc_mass(const dgfem_mvc *body);
DGFEM_API dgfem_real dgfem_mvc_rest_volume(const dgfem_mvc *body);
/* Volume inside the current, triangulated boundary. */
DGFEM_API dgfem_real dgfem_mvc_volume(const dgfem_mvc *body);

/* ---- cutting ---- */

/* Told of each piece that has come off: `piece` as dgfem_mvc_pieces numbers it, and its elements. Of what hung together
   before, the largest part is not new. Called at the end, when all is done; the body must not be changed in it. */
typedef void (*dgfem_mvc_new_piece_fn)(void *user, const dgfem_mvc *body, int piece, const int *elements,
                                       int element_count);

typedef struct dgfem_mvc_cut_desc {
    unsigned cookie;
    int current;        /* 0: the blade is meant at rest; 1 (default): in the current positions */
    dgfem_real snap;    /* a node nearer to the blade than this part of a crossed edge counts as on it; default 0.05,
                           at least 1e-6 (1e-4 in float) is taken */
    int remove_slivers; /* 1 (default): flat and needle-like elements that the cut leaves are removed */
    dgfem_real quality; /* elements are flat or needles where 3 V / (surface * diameter) is below; default 0.02 */
    dgfem_mvc_new_piece_fn new_piece; /* or NULL */
    void *new_piece_user;
} dgfem_mvc_cut_desc;

typedef struct dgfem_mvc_cut_info {
    int elements_split;
    int elements_kept;   /* that the blade passes, but stay whole: else they or neighbours would not be star-shaped;
                            for a surface, the sum over its triangles */
    int faces_cut;       /* that came apart; 0: the blade missed or only touched */
    int nodes_added;     /* on edges and in faces */
    int nodes_copied;    /* where elements came apart */
    int slivers_removed; /* flat elements and needles that vanished */
    int slivers_left;    /* elements below `quality` that could not be removed */
    int pieces;          /* connected parts afterwards */
} dgfem_mvc_cut_info;

DGFEM_API dgfem_mvc_cut_desc dgfem_default_mvc_cut_desc(void);

/* Splits all elements that straddle the plane; both parts stay connected. Like every cut: desc (NULL: the default) and
   info may be NULL; on failure nothing has changed, a change raises the revision. New nodes take the state between
   those of their edge. A cut does what it can: an element that no split leaves star-shaped stays whole, and is counted
   in info->elements_kept. */
DGFEM_API dgfem_status dgfem_mvc_split_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info);

/* The same for one element; its neighbours gain hanging nodes. */
DGFEM_API dgfem_status dgfem_mvc_split_element(dgfem_mvc *body, int element, dgfem_plane plane,
                                               const dgfem_mvc_cut_desc *desc, dgfem_mvc_cut_info *info);

/* Cuts along a whole plane. */
DGFEM_API dgfem_status dgfem_mvc_cut_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                           dgfem_mvc_cut_info *info);

/* Cuts inside a planar polygon, convex or not, in either sense; elements it meets are split along its plane, and their
   parts stay connected outside of it. */
DGFEM_API dgfem_status dgfem_mvc_cut_polygon(dgfem_mvc *body, dgfem_points_in polygon, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info);

/* Cuts along triangles (three vertex indices each), one after the other: a surface, or what a moving edge has swept.
   Triangles without area cut nothing. Nodes are snapped by the least that desc.snap allows, whatever it says, for the
   cuts must meet. */
DGFEM_API dgfem_status dgfem_mvc_cut_surface(dgfem_mvc *body, dgfem_points_in vertices, const int *triangles,
                                             int triangle_count, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info);

/* Removes flat and needle-like elements: those whose quality 3 V / (surface * diameter) is below. */
DGFEM_API dgfem_status dgfem_mvc_remove_slivers(dgfem_mvc *body, dgfem_real quality, dgfem_mvc_cut_info *info);

/* 3 V / (surface * diameter) of an element: cube 0.29, regular tetrahedron 0.20, slab of 1 x 1 x 0.01 0.01; 0 where
   there is no such element. */
DGFEM_API dgfem_real dgfem_mvc_quality(const dgfem_mvc *body, int element);

/* Numbers the connected pieces in the order of their first elements: piece_of[element_count] (may be NULL) receives
   each element's, pieces (may be NULL) the first `capacity` of them, *count their number. */
DGFEM_API dgfem_status dgfem_mvc_pieces(const dgfem_mvc *body, int *piece_of, dgfem_piece *pieces, int capacity,
                                        int *count);

/* ---- skin and surface ---- */

typedef enum dgfem_mvc_skin_kind {
    DGFEM_MVC_SKIN_MEAN_VALUE, /* follows elements to their surface, continuously; edges of elements show */
    DGFEM_MVC_SKIN_MLS         /* moving least squares over the nodes around: smooth (C2), but it follows nodes only in
                                  the mean, and costs more */
} dgfem_mvc_skin_kind;

typedef struct dgfem_mvc_skin_desc {
    unsigned cookie;
    dgfem_mvc_skin_kind kind; /* default DGFEM_MVC_SKIN_MEAN_VALUE */
    dgfem_points_in vertices; /* rest positions, in the caller's order, which is kept */
    const int *triangles;     /* three vertex indices each, or NULL: no normals */
    int triangle_count;
    dgfem_hooks hooks;
} dgfem_mvc_skin_desc;

/* A render mesh that follows a body. MEAN_VALUE: each vertex by the mean value coordinates of the element that contains
   it, which are continuous across elements. A vertex outside of the body, at X, belongs to the nearest point P of its
   surface:
     x = sum (phi_i(P) + <grad phi_i> . (X - P)) x_i,   < > the mean over the element.
   It moves affinely with the element's mean deformation, continuously up to the surface.

   MLS: each vertex by the affine function that fits the nodes around best, as in skins of dgfem.h. Nodes reach a vertex
   only through elements that hang together: never across a cut, and around its front the less the longer the way is.
   Affine motions are followed exactly, outside as well. Where the nodes around are nearly in a plane, mean value
   coordinates serve instead. */
typedef struct dgfem_mvc_skin {
    int vertex_count, triangle_count;
    dgfem_vec3 *positions; /* as of the last update */
    dgfem_vec3 *normals;   /* unit, angle-weighted; zero where no triangle has area; NULL without triangles */
    int *triangles;
    dgfem_vec3 *rest;  /* [vertex_count] */
    int *element;      /* [vertex_count] that contains the vertex, or the nearest */
    int *weight_start; /* [vertex_count + 1] */
    int *weight_node;
    dgfem_real *weight;
    dgfem_mvc_skin_kind kind;
    int revision, node_count; /* of the body it was made for */
    dgfem_hooks hooks;
} dgfem_mvc_skin;

DGFEM_API dgfem_mvc_skin_desc dgfem_default_mvc_skin_desc(void);
DGFEM_API dgfem_status dgfem_mvc_skin_create(const dgfem_mvc *body, const dgfem_mvc_skin_desc *desc,
                                             dgfem_mvc_skin **out);
DGFEM_API void dgfem_mvc_skin_destroy(dgfem_mvc_skin *skin);
/* New weights after a cut: vertices stay in the rest place they have. On failure nothing has changed. */
DGFEM_API dgfem_status dgfem_mvc_skin_renew(dgfem_mvc_skin *skin, const dgfem_mvc *body);
/* Follows the body; nothing is allocated. DGFEM_ERROR_REVISION when its topology has changed. */
DGFEM_API dgfem_status dgfem_mvc_skin_update(dgfem_mvc_skin *skin, const dgfem_mvc *body);

/* The boundary of the elements as triangles: what the method itself moves. Where faces meet by more than 60 degrees at
   rest edges are sharp: each side has vertices of its own. */
typedef struct dgfem_mvc_surface {
    int vertex_count, triangle_count;
    dgfem_vec3 *positions;    /* as of the last update */
    dgfem_vec3 *normals;      /* unit, angle-weighted */
    int *triangles;           /* counter-clockwise from outside */
    int *face;                /* [triangle_count] of the body */
    int *node;                /* [vertex_count] of the body */
    int revision, node_count; /* of the body it was made for */
    dgfem_hooks hooks;
} dgfem_mvc_surface;

DGFEM_API dgfem_status dgfem_mvc_surface_create(const dgfem_mvc *body, dgfem_mvc_surface **out);
DGFEM_API void dgfem_mvc_surface_destroy(dgfem_mvc_surface *surface);
DGFEM_API dgfem_status dgfem_mvc_surface_update(dgfem_mvc_surface *surface, const dgfem_mvc *body);

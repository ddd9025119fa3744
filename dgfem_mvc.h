/* dgfem_mvc.h - finite elements on polyhedra by mean value coordinates

   A single-header library in C99 (also C++), sister of dgfem.h. It moves elastic solids made of polyhedra: conforming,
   one displacement per node, continuous across elements whatever the number of their faces and nodes, hanging ones
   included; large rotations, contact, cuts that split elements by planes. It needs dgfem.h, libc and libm.

   The method is that of M. Wicke, M. Botsch, M. Gross, "A finite element method on convex polyhedra" (Eurographics
   2007), with a correction of its quadrature that makes it converge. Equation numbers in comments refer to that
   paper.


   HOW TO BUILD IT IN

   In exactly one C or C++ file:

       #define DGFEM_IMPLEMENTATION
       #include "dgfem_mvc.h"

   and everywhere else only #include "dgfem_mvc.h". It includes dgfem.h, which the same macro implements in the same
   file. Configuration macros, hooks, descriptors, units and statuses are those of dgfem.h: see there.


   HOW IT IS USED

       dgfem_mesh_create_grid, _tetrahedra, _polyhedra, _slices        a mesh of dgfem.h; also dgfem_mesh_split_plane
       dgfem_mvc_create                                                -> a body: a node per corner of the mesh
       dgfem_mvc_fix_nodes, _move_fixture, _pin, _drag                 what holds and moves it
       dgfem_mvc_set_traction, _set_pressure, _add_force, _set_gravity what loads it
       dgfem_mvc_add_plane, _add_sphere, _move_shape                   what it touches, with friction
       dgfem_mvc_step                                                  motion, by semi-implicit Euler
       dgfem_mvc_solve_static                                          equilibrium
       dgfem_mvc_split_plane, _cut_plane, _cut_polygon, _cut_surface   refinement and cuts; _remove_slivers, _pieces
       dgfem_mvc_skin_create, _update; dgfem_mvc_surface_create        a render mesh that follows it; its own boundary
       dgfem_mvc_coordinates                                           the basis functions, for any purpose

   An element is any polyhedron that its centroid sees all of: convex ones, and slightly bent ones that a cut has
   left. Its displacement interpolates its nodes by mean value coordinates: smooth inside, linear on the triangles of
   its faces, so that neighbours always agree. On tetrahedra they are the usual linear functions. A node that lies on
   an edge of a neighbour is a node of the neighbour too: there are no constraints, and nothing has to be subdivided
   further.

   Large rotations are dealt with by stiffness warping: a linear element in a frame that turns with it. One linear
   system is solved in each step; pattern and symbolic factorization are made once, and again in the first step after
   cuts. With parallel_for in the hooks, rotations, forces, the matrix and its factorization are computed by the
   caller's threads, to the same bits for any number of them.


   A WHOLE PROGRAM

       #define DGFEM_IMPLEMENTATION
       #include "dgfem_mvc.h"
       #include <stdio.h>

       int main(void) {
           // 1. A bar of 0.4 m x 0.1 m x 0.1 m of soft rubber in eight boxes; gravity is (0, 0, -9.81) m/s^2.
           dgfem_grid_desc grid = dgfem_default_grid_desc();
           dgfem_vec3 upper = {DGFEM_R(0.4), DGFEM_R(0.1), DGFEM_R(0.1)};
           grid.upper = upper;
           grid.cells[0] = 8;
           dgfem_mesh *mesh;
           dgfem_status status = dgfem_mesh_create_grid(&grid, &mesh);
           if (status) return puts(dgfem_status_text(status)), 1;

           dgfem_mvc_desc desc = dgfem_default_mvc_desc();
           desc.mesh = mesh; // is copied
           desc.material.young = DGFEM_R(2e5);
           desc.damping_mass = 2;
           dgfem_mvc *body;
           status = dgfem_mvc_create(&desc, &body);
           dgfem_mesh_destroy(mesh);
           if (status) return puts(dgfem_status_text(status)), 1;

           // 2. Hold the side x = 0.
           dgfem_plane wall = {{1, 0, 0}, 0};
           dgfem_vec3 zero = {0, 0, 0};
           int nodes[16];
           int count = dgfem_mvc_nodes_on_plane(body, wall, DGFEM_R(1e-6), nodes, 16);
           if (dgfem_mvc_fix_nodes(body, nodes, count, DGFEM_MVC_XYZ, zero, NULL)) return 1;

           // 3. One second of swinging; then it is cut through, askew, where it is then.
           int tip = dgfem_mvc_nearest_node(body, upper);
           for (int step = 1; step <= 60; step++)
               if (dgfem_mvc_step(body, DGFEM_R(1) / 60, NULL)) return 1;
           printf("the tip hangs %.2f m lower\n", (double)(upper.z - body->position[tip].z));
           dgfem_plane blade = {{1, 0, DGFEM_R(0.3)}, DGFEM_R(0.22)};
           dgfem_mvc_cut_info info;
           if (dgfem_mvc_cut_plane(body, blade, NULL, &info)) return 1;
           printf("%d pieces, %d nodes\n", info.pieces, body->node_count);

           // 4. Triangles to draw: update them after each step, make them anew after each cut.
           dgfem_mvc_surface *surface;
           if (dgfem_mvc_surface_create(body, &surface)) return 1;
           if (dgfem_mvc_step(body, DGFEM_R(1) / 60, NULL)) return 1;
           if (dgfem_mvc_surface_update(surface, body)) return 1;
           printf("%d triangles\n", surface->triangle_count);
           dgfem_mvc_surface_destroy(surface);
           dgfem_mvc_destroy(body);
           return 0;
       }


   WHAT IT DOES NOT DO

   - Materials other than isotropic linear ones, in each element's frame. Warped forces have no net force but, for large
     strains, a small net torque: a spinning body loses or gains angular momentum slowly.
   - Contact of a body with itself or another. It touches shapes at its nodes: a corner of a shape may pass between.
   - Faces with holes, and elements that their centroid does not see all of: split them before (dgfem_mesh_split_plane).
   - Friction that holds a slope for ever: below slip_speed it is viscous, and a body creeps.


   NUMERIC LIMITS

   - Coordinates are good to round-off, gradients to size / distance from the surface times that, in elements of any
     thickness in double. In float, elements thinner than 1e-4 of their size are beyond it.
   - Displacements converge with the square of the element size, stresses with its first power, with the corrected rules
     (TET4, PAPER) on any mesh. PAPER_RAW need not converge: its patch test fails by per cents.
   - Elements with edges below about 1e-3 of their size have modes of next to no stiffness: set `stabilisation` to 0.1.
   - Poisson's ratio above about 0.45 stiffens (at 0.4999 a bending bar keeps a tenth of its energy): set b_bar. Above
     0.499 use double.
   - dgfem_mvc_solve_static converges for moderate bending; beyond, take load steps, or time steps with damping.
   - A step is as stable as semi-implicit Euler: it damps a motion of angular frequency w by about dt w^2 / 2 of its
     amplitude per unit of time. Very large strains and inverted elements recover, but with dt too long for them they
     jump about.
   - An element that no split leaves star-shaped stays whole, and holds together what a cut should part:
     dgfem_mvc_cut_info.elements_kept tells. Such elements are very flat or not convex; many snapped cuts make some.
   - Cuts make small elements. Those cost accuracy and condition; `snap` and remove_slivers keep most of them away.


   LICENCE

   MIT; the text stands at the end of this file. */

/* Contents, in the order of dependency; search for "== name".

   api.h              Public types and declarations of finite elements on polyhedra.
   base.c             Log, memory and small vectors of this header's own.
   basis.c            Mean value coordinates of polyhedra: values and gradients.
   mesh.c             The complex of nodes, faces and elements: storage, access, measures, changes, compacting.
   triangulate.c      Triangles of faces, stored once for both sides.
   build.c            From a cell complex to nodes, faces and elements; the check of all invariants.
   element.c          Integrals of one element: volume fractions, mean gradients, stiffness.
   system.c           What follows from a mesh and materials: nodal masses, integrals of all elements, the block matrix
                      and its solver.
   create.c           A body's beginning and end.
   conditions.c       What holds and loads a body: the list of conditions and contact shapes.
   warp.c             Stiffness warping: rotations of elements, elastic forces and stiffness in rotated frames.
   load.c             External forces, contact, held nodes.
   solve.c            Moving a body: the time step and the static solve.
   query.c            Questions about a body: its mesh, stress, forces, energy, momentum, volume.
   renew.c            A body takes over an edited copy of its mesh.
   split.c            Splitting elements by a plane.
   crack.c            Cuts: faces on a blade come apart.
   sliver.c           Removing flat elements and needles.
   cut.c              Cuts of meshes and bodies.
   locate.c           Where points are at rest: the element that contains one, or the nearest place of the boundary.
   embed.c            Embedding of points by moving least squares (MLS) over the nodes.
   skin.c             Render meshes that follow a body: by mean value coordinates in the element that contains a
                      vertex, or by moving least squares over the nodes around it.
   surface.c          The boundary of a body as triangles. */

#include "dgfem.h"

#ifndef DGFEM_MVC_H
#define DGFEM_MVC_H

/* ==== api.h ======================================================================================================= */

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

#endif /* DGFEM_MVC_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_MVC_IMPLEMENTED)
#define DGFEM_MVC_IMPLEMENTED

/* ==== base.c ====================================================================================================== */

/* Log, memory and small vectors of this header's own. */

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
#define DGFEM_MVC_PRINTF(format_index, first) __attribute__((format(printf, format_index, first)))
#else
#define DGFEM_MVC_PRINTF(format_index, first)
#endif

#define DGFEM_MVC_COOKIE 0x3c5c0001u

/* ---- log ---- */

/* Logs one line and returns the status. */
DGFEM_MVC_PRINTF(3, 4)
static dgfem_status dgfem_mvci_fail(const dgfem_hooks *hooks, dgfem_status status, const char *format, ...) {
    char text[512];
    if (!hooks->log) return status;
    snprintf(text, sizeof text, "dgfem_mvc: %s: ", dgfem_status_text(status));
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - used, format, arguments);
    va_end(arguments);
    hooks->log(hooks->log_user, DGFEM_LOG_ERROR, text);
    return status;
}

static dgfem_status dgfem_mvci_fail_memory(const dgfem_hooks *hooks) {
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_MEMORY, "the allocator returned NULL");
}

/* ---- memory ---- */

static void *dgfem_mvci_reallocate(const dgfem_hooks *hooks, void *pointer, size_t count, size_t size) {
    if (!count) count = 1; /* NULL always means failure */
    if (count > (size_t)PTRDIFF_MAX / size) return NULL;
    if (hooks->reallocate) return hooks->reallocate(hooks->reallocate_user, pointer, count * size);
    return realloc(pointer, count * size);
}

/* Zeroed. */
static void *dgfem_mvci_allocate(const dgfem_hooks *hooks, size_t count, size_t size) {
    void *pointer = dgfem_mvci_reallocate(hooks, NULL, count, size);
    if (pointer) memset(pointer, 0, (count ? count : 1) * size);
    return pointer;
}

static void *dgfem_mvci_duplicate(const dgfem_hooks *hooks, const void *source, size_t count, size_t size) {
    void *copy = dgfem_mvci_allocate(hooks, count, size);
    if (copy && count) memcpy(copy, source, count * size);
    return copy;
}

static void dgfem_mvci_free(const dgfem_hooks *hooks, void *pointer) {
    if (!pointer) return;
    if (hooks->reallocate) (void)hooks->reallocate(hooks->reallocate_user, pointer, 0);
    else free(pointer);
}

/* Temporary memory of one operation. Zeroed memory with `hooks` set is empty. */
typedef struct dgfem_mvci_scratch {
    const dgfem_hooks *hooks;
    void *blocks[32];
    int count;
} dgfem_mvci_scratch;

static dgfem_mvci_scratch dgfem_mvci_scratch_make(const dgfem_hooks *hooks) {
    dgfem_mvci_scratch scratch;
    memset(&scratch, 0, sizeof scratch);
    scratch.hooks = hooks;
    return scratch;
}

static void *dgfem_mvci_take(dgfem_mvci_scratch *scratch, size_t count, size_t size) {
    DGFEM_ASSERT(scratch->count < 32);
    void *pointer = dgfem_mvci_allocate(scratch->hooks, count, size);
    if (pointer) scratch->blocks[scratch->count++] = pointer;
    return pointer;
}

static void dgfem_mvci_scratch_free(dgfem_mvci_scratch *scratch) {
    while (scratch->count) dgfem_mvci_free(scratch->hooks, scratch->blocks[--scratch->count]);
}

/* ---- time and parallel loops ---- */

/* fn for ranges of 0 <= i < count, in the caller's threads where there are any. */
static void dgfem_mvci_run(const dgfem_hooks *hooks, int count, int grain, dgfem_range_fn fn, void *context) {
    if (hooks->parallel_for && count > grain) hooks->parallel_for(hooks->parallel_for_user, count, grain, fn, context);
    else fn(context, 0, count);
}

static double dgfem_mvci_clock(const dgfem_hooks *hooks) { return hooks->clock ? hooks->clock(hooks->clock_user) : 0; }

/* ---- scalars and vectors ---- */

#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_EPSILON 1.1920929e-7f
#else
#define DGFEM_MVC_EPSILON 2.220446049250313e-16
#endif

static dgfem_real dgfem_mvci_sqrt(dgfem_real x) { return (dgfem_real)sqrt((double)x); }
static dgfem_real dgfem_mvci_abs(dgfem_real x) { return x < 0 ? -x : x; }
static dgfem_real dgfem_mvci_max(dgfem_real a, dgfem_real b) { return a > b ? a : b; }
static int dgfem_mvci_is_finite(dgfem_real x) { return x - x == 0; }

static dgfem_vec3 dgfem_mvci_vec3(dgfem_real x, dgfem_real y, dgfem_real z) {
    dgfem_vec3 v;
    v.x = x, v.y = y, v.z = z;
    return v;
}
static dgfem_vec3 dgfem_mvci_add(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}
static dgfem_vec3 dgfem_mvci_sub(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static dgfem_vec3 dgfem_mvci_scale(dgfem_real s, dgfem_vec3 a) { return dgfem_mvci_vec3(s * a.x, s * a.y, s * a.z); }
static dgfem_vec3 dgfem_mvci_axpy(dgfem_vec3 a, dgfem_real s, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
/* s a + t b */
static dgfem_vec3 dgfem_mvci_blend(dgfem_real s, dgfem_vec3 a, dgfem_real t, dgfem_vec3 b) {
    return dgfem_mvci_axpy(dgfem_mvci_scale(s, a), t, b);
}
static dgfem_real dgfem_mvci_dot(dgfem_vec3 a, dgfem_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static dgfem_vec3 dgfem_mvci_cross(dgfem_vec3 a, dgfem_vec3 b) {
    return dgfem_mvci_vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static dgfem_real dgfem_mvci_norm(dgfem_vec3 a) { return dgfem_mvci_sqrt(dgfem_mvci_dot(a, a)); }
/* The zero vector stays zero. */
static dgfem_vec3 dgfem_mvci_unit(dgfem_vec3 a) {
    dgfem_real length = dgfem_mvci_norm(a);
    return length > 0 ? dgfem_mvci_scale(1 / length, a) : a;
}
static int dgfem_mvci_is_finite3(dgfem_vec3 a) {
    return dgfem_mvci_is_finite(a.x) && dgfem_mvci_is_finite(a.y) && dgfem_mvci_is_finite(a.z);
}

static dgfem_mat3 dgfem_mvci_identity(void) {
    dgfem_mat3 a;
    memset(&a, 0, sizeof a);
    a.m[0][0] = a.m[1][1] = a.m[2][2] = 1;
    return a;
}
static dgfem_vec3 dgfem_mvci_multiply(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_mvci_vec3(a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                           a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                           a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z);
}
static dgfem_vec3 dgfem_mvci_multiply_transposed(const dgfem_mat3 *a, dgfem_vec3 v) {
    return dgfem_mvci_vec3(a->m[0][0] * v.x + a->m[1][0] * v.y + a->m[2][0] * v.z,
                           a->m[0][1] * v.x + a->m[1][1] * v.y + a->m[2][1] * v.z,
                           a->m[0][2] * v.x + a->m[1][2] * v.y + a->m[2][2] * v.z);
}
static dgfem_mat3 dgfem_mvci_multiply3(const dgfem_mat3 *a, const dgfem_mat3 *b) {
    dgfem_mat3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[i][j] = a->m[i][0] * b->m[0][j] + a->m[i][1] * b->m[1][j] + a->m[i][2] * b->m[2][j];
    return c;
}
static dgfem_mat3 dgfem_mvci_transposed(const dgfem_mat3 *a) {
    dgfem_mat3 t;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) t.m[i][j] = a->m[j][i];
    return t;
}
/* a += s u v^T */
static void dgfem_mvci_add_outer(dgfem_mat3 *a, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 su = dgfem_mvci_scale(s, u);
    a->m[0][0] += su.x * v.x, a->m[0][1] += su.x * v.y, a->m[0][2] += su.x * v.z;
    a->m[1][0] += su.y * v.x, a->m[1][1] += su.y * v.y, a->m[1][2] += su.y * v.z;
    a->m[2][0] += su.z * v.x, a->m[2][1] += su.z * v.y, a->m[2][2] += su.z * v.z;
}
/* Inverse of a symmetric matrix by cofactors; 0 where it has none. */
static int dgfem_mvci_invert(const dgfem_mat3 *a, dgfem_mat3 *out) {
    dgfem_vec3 r[3], c[3];
    for (int i = 0; i < 3; i++) r[i] = dgfem_mvci_vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    for (int i = 0; i < 3; i++) c[i] = dgfem_mvci_cross(r[(i + 1) % 3], r[(i + 2) % 3]);
    dgfem_real det = dgfem_mvci_dot(r[0], c[0]);
    if (!(dgfem_mvci_abs(det) > 0) || !dgfem_mvci_is_finite(det)) return 0;
    for (int j = 0; j < 3; j++) {
        out->m[0][j] = c[j].x / det;
        out->m[1][j] = c[j].y / det;
        out->m[2][j] = c[j].z / det;
    }
    return 1;
}

/* ---- strided points ---- */

static dgfem_status dgfem_mvci_check_points(const dgfem_hooks *hooks, const dgfem_points_in *points, const char *what) {
    int size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    if (points->count < 0 || (points->count > 0 && !points->data))
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: no data for %d points", what, points->count);
    if (points->type != DGFEM_FLOAT32 && points->type != DGFEM_FLOAT64)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: unknown number type %d", what, (int)points->type);
    if (points->stride && points->stride < size)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s: a stride of %d bytes does not hold a point", what,
                               points->stride);
    return DGFEM_OK;
}

static dgfem_vec3 dgfem_mvci_read_point(const dgfem_points_in *points, int i) {
    size_t size = points->type == DGFEM_FLOAT32 ? 12 : 24;
    const char *data = (const char *)points->data + (size_t)i * (points->stride ? (size_t)points->stride : size);
    float f[3];
    double d[3];
    if (points->type == DGFEM_FLOAT64) {
        memcpy(d, data, sizeof d);
        return dgfem_mvci_vec3((dgfem_real)d[0], (dgfem_real)d[1], (dgfem_real)d[2]);
    }
    memcpy(f, data, sizeof f);
    return dgfem_mvci_vec3((dgfem_real)f[0], (dgfem_real)f[1], (dgfem_real)f[2]);
}

/* ==== basis.c ===================================================================================================== */

/* Mean value coordinates of polyhedra: values and gradients.

   Seen from x, a triangle with corners d_0, d_1, d_2 (relative to x, lengths r_i) fills a spherical triangle. The
   integral of its unit directions is, by Stokes' theorem, half the sum over its edges of angle times unit normal:

     m = 1/2 sum_e g_e C_e,    C_e = d_j x d_k,  g_e = theta_e / |C_e|      (edge e lies opposite corner e)

   Written as m = sum w_i d_i it gives each corner the weight w_i = (m . C_i) / D,  D = d_0 . C_0 = 6 times the volume
   of the tetrahedron over the triangle. Weights of a node add up over its triangles; phi_i = w_i / sum w. That is eq.
   (7) to (9), summed by triangles instead of by one-rings, and stays accurate in thin cells. Gradients are its
   derivatives:

     grad g    = g (d_j / r_j^2 + d_k / r_k^2) + h / (r_j r_k)^2 ((d_j + d_k) - cos (r_k / r_j d_j + r_j / r_k d_k)),
                 h = (sin - theta cos) / sin^3
     grad num_i = sum_e grad g_e (C_e . C_i) + g_e (v_e x C_i + v_i x C_e),    v_i = x_j - x_k,  num_i = 2 m . C_i
     grad D    = -N,   N = (x_1 - x_0) x (x_2 - x_0) */

/* Nearer to a plane than this times the size of the cell, a point counts as in it. */
#define DGFEM_MVCI_IN_PLANE (16 * DGFEM_MVC_EPSILON)
/* A triangle lower than this times its longest edge has no area. */
#define DGFEM_MVCI_FLAT (16 * DGFEM_MVC_EPSILON)

/* (sin t - t cos t) / sin^3 t; below t = 1/4 the difference would lose digits. */
static dgfem_real dgfem_mvci_angle_term(dgfem_real t, dgfem_real cosine, dgfem_real sine) {
    dgfem_real s = t * t, sum = DGFEM_R(4.0 / 200475);
    if (t > DGFEM_R(0.25)) return (sine - t * cosine) / (sine * sine * sine);
    sum = DGFEM_R(2764.0 / 19348875) + s * sum;
    sum = DGFEM_R(2.0 / 2079) + s * sum;
    sum = DGFEM_R(4.0 / 675) + s * sum;
    sum = DGFEM_R(2.0 / 63) + s * sum;
    sum = DGFEM_R(2.0 / 15) + s * sum;
    return DGFEM_R(1.0 / 3) + s * sum;
}

/* g = theta / |a x b| of an edge from a to b, of lengths ra and rb, seen from the origin, and its derivative by a
   motion of the viewer. */
static dgfem_real dgfem_mvci_edge_weight(dgfem_vec3 a, dgfem_vec3 b, dgfem_real ra, dgfem_real rb, dgfem_vec3 cross,
                                         dgfem_vec3 *gradient) {
    dgfem_real rr = ra * rb, s = dgfem_mvci_norm(cross), c = dgfem_mvci_dot(a, b);
    dgfem_real sine = s / rr, cosine = c / rr, angle = (dgfem_real)atan2((double)s, (double)c);
    dgfem_real g = (angle < DGFEM_R(1e-4) ? 1 + angle * angle / 6 : angle / sine) / rr;
    if (!gradient) return g;
    dgfem_real h = dgfem_mvci_angle_term(angle, cosine, sine) / (rr * rr);
    *gradient =
        dgfem_mvci_blend(g / (ra * ra) + h * (1 - cosine * rb / ra), a, g / (rb * rb) + h * (1 - cosine * ra / rb), b);
    return g;
}

/* Weights w_i of a triangle's corners d, and their gradients (or NULL). Products of two edges serve both of their
   corners. */
static void dgfem_mvci_triangle_weights(const dgfem_vec3 *d, dgfem_vec3 normal, dgfem_real volume, dgfem_real *w,
                                        dgfem_vec3 *gradients) {
    dgfem_vec3 cross[3], v[3], edge_gradient[3];
    dgfem_real g[3], r[3], half = 1 / (2 * volume);
    for (int i = 0; i < 3; i++) r[i] = dgfem_mvci_norm(d[i]);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        cross[i] = dgfem_mvci_cross(d[j], d[k]);
        v[i] = dgfem_mvci_sub(d[j], d[k]);
        g[i] = dgfem_mvci_edge_weight(d[j], d[k], r[j], r[k], cross[i], gradients ? &edge_gradient[i] : NULL);
        w[i] = 0;
        if (gradients) gradients[i] = dgfem_mvci_vec3(0, 0, 0);
    }
    for (int i = 0; i < 3; i++)
        for (int e = 0; e <= i; e++) {
            dgfem_real product = dgfem_mvci_dot(cross[e], cross[i]);
            w[i] += half * g[e] * product;
            if (e < i) w[e] += half * g[i] * product;
            if (!gradients) continue;
            dgfem_vec3 turn = dgfem_mvci_add(dgfem_mvci_cross(v[e], cross[i]), dgfem_mvci_cross(v[i], cross[e]));
            dgfem_vec3 *to = &gradients[i];
            *to = dgfem_mvci_add(*to, dgfem_mvci_blend(half * product, edge_gradient[e], half * g[e], turn));
            to = &gradients[e];
            if (e < i) *to = dgfem_mvci_add(*to, dgfem_mvci_blend(half * product, edge_gradient[i], half * g[i], turn));
        }
    for (int i = 0; gradients && i < 3; i++) gradients[i] = dgfem_mvci_axpy(gradients[i], 2 * half * w[i], normal);
}

/* Whether the origin, which is in the triangle's plane, is in the triangle: then b are its barycentric coordinates. */
static int dgfem_mvci_in_triangle(const dgfem_vec3 *d, dgfem_vec3 normal, dgfem_real *b) {
    dgfem_real area = dgfem_mvci_norm(normal), sum = 0;
    for (int i = 0; i < 3; i++) {
        dgfem_vec3 from = d[(i + 1) % 3], to = d[(i + 2) % 3];
        b[i] = dgfem_mvci_dot(normal, dgfem_mvci_cross(from, to)) / (area * area);
        dgfem_real distance = b[i] * area / dgfem_mvci_norm(dgfem_mvci_sub(to, from));
        if (!(distance >= -DGFEM_MVCI_IN_PLANE)) return 0;
        b[i] = dgfem_mvci_max(b[i], 0);
        sum += b[i];
    }
    for (int i = 0; i < 3; i++) b[i] /= sum;
    return 1;
}

/* One triangle as x sees it, scaled. */
typedef struct dgfem_mvci_view {
    dgfem_vec3 corner[3]; /* relative to x */
    dgfem_vec3 normal;    /* twice the area long */
    dgfem_real volume;    /* six times that of the tetrahedron over the triangle */
    int flat;             /* has no area */
    int in_plane;         /* x is in its plane */
} dgfem_mvci_view;

static dgfem_mvci_view dgfem_mvci_look(const dgfem_vec3 *nodes, const int *triangle, dgfem_vec3 x, dgfem_real scale) {
    dgfem_mvci_view view;
    dgfem_vec3 edge[3];
    dgfem_real longest = 0, nearest = -1;
    int base = 0;
    for (int i = 0; i < 3; i++) {
        edge[i] = dgfem_mvci_sub(nodes[triangle[(i + 1) % 3]], nodes[triangle[i]]);
        edge[i] = dgfem_mvci_scale(scale, edge[i]);
        view.corner[i] = dgfem_mvci_scale(scale, dgfem_mvci_sub(nodes[triangle[i]], x));
        dgfem_real r = dgfem_mvci_dot(view.corner[i], view.corner[i]);
        if (nearest < 0 || r < nearest) nearest = r, base = i;
        longest = dgfem_mvci_max(longest, dgfem_mvci_dot(edge[i], edge[i]));
    }
    view.normal = dgfem_mvci_cross(edge[0], edge[1]);
    view.volume = dgfem_mvci_dot(view.corner[base], view.normal);
    dgfem_real area = dgfem_mvci_norm(view.normal);
    view.flat = !(area > DGFEM_MVCI_FLAT * longest);
    view.in_plane = dgfem_mvci_abs(view.volume) <= DGFEM_MVCI_IN_PLANE * area;
    return view;
}

/* Values phi[count] of a closed triangulated cell at x, and gradients (or NULL). Returns 1, or 0 where x lies on the
   surface: then phi is linear on the triangle and gradients mean nothing. Triangles without area, and those whose plane
   passes through x, have no weight. */
static int dgfem_mvci_basis(const dgfem_vec3 *nodes, int count, const int *triangles, int triangle_count, dgfem_vec3 x,
                            dgfem_real *phi, dgfem_vec3 *gradients) {
    dgfem_real size = 0, sum = 0;
    dgfem_vec3 slope = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < count; i++) {
        size = dgfem_mvci_max(size, dgfem_mvci_norm(dgfem_mvci_sub(nodes[i], x)));
        phi[i] = 0;
        if (gradients) gradients[i] = slope;
    }
    for (int t = 0; t < triangle_count; t++) {
        const int *at = triangles + 3 * t;
        dgfem_mvci_view view = dgfem_mvci_look(nodes, at, x, 1 / size);
        dgfem_real w[3];
        dgfem_vec3 dw[3];
        if (view.flat) continue;
        if (view.in_plane) {
            if (!dgfem_mvci_in_triangle(view.corner, view.normal, w)) continue;
            for (int i = 0; i < count; i++) phi[i] = 0;
            for (int i = 0; i < 3; i++) phi[at[i]] = w[i];
            return 0;
        }
        dgfem_mvci_triangle_weights(view.corner, view.normal, view.volume, w, gradients ? dw : NULL);
        for (int i = 0; i < 3; i++) {
            phi[at[i]] += w[i];
            sum += w[i];
            if (!gradients) continue;
            gradients[at[i]] = dgfem_mvci_add(gradients[at[i]], dw[i]);
            slope = dgfem_mvci_add(slope, dw[i]);
        }
    }
    for (int i = 0; i < count; i++) {
        phi[i] /= sum;
        if (gradients) gradients[i] = dgfem_mvci_scale(1 / (sum * size), dgfem_mvci_axpy(gradients[i], -phi[i], slope));
    }
    return 1;
}

/* ---- public ---- */

/* Closed surfaces have no vector area: a cheap necessary condition. */
static dgfem_status dgfem_mvci_check_cell(const dgfem_mvc_cell *cell) {
    dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real whole = 0;
    if (cell->node_count < 4 || cell->triangle_count < 4 || !cell->nodes || !cell->triangles)
        return DGFEM_ERROR_ARGUMENT;
    for (int i = 0; i < cell->node_count; i++)
        if (!dgfem_mvci_is_finite3(cell->nodes[i])) return DGFEM_ERROR_NOT_FINITE;
    for (int t = 0; t < cell->triangle_count; t++) {
        const int *at = cell->triangles + 3 * t;
        for (int i = 0; i < 3; i++)
            if (at[i] < 0 || at[i] >= cell->node_count) return DGFEM_ERROR_INDEX;
        dgfem_vec3 normal = dgfem_mvci_cross(dgfem_mvci_sub(cell->nodes[at[1]], cell->nodes[at[0]]),
                                             dgfem_mvci_sub(cell->nodes[at[2]], cell->nodes[at[0]]));
        sum = dgfem_mvci_add(sum, normal);
        whole += dgfem_mvci_norm(normal);
    }
    if (!(whole > 0)) return DGFEM_ERROR_DEGENERATE;
    return dgfem_mvci_norm(sum) <= DGFEM_R(1e-4) * whole ? DGFEM_OK : DGFEM_ERROR_OPEN;
}

DGFEM_API dgfem_status dgfem_mvc_coordinates(const dgfem_mvc_cell *cell, dgfem_vec3 x, dgfem_real *values,
                                             dgfem_vec3 *gradients) {
    if (!cell || !values) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_cell(cell);
    if (status) return status;
    if (!dgfem_mvci_is_finite3(x)) return DGFEM_ERROR_NOT_FINITE;
    int inside =
        dgfem_mvci_basis(cell->nodes, cell->node_count, cell->triangles, cell->triangle_count, x, values, gradients);
    for (int i = 0; i < cell->node_count; i++)
        if (!dgfem_mvci_is_finite(values[i])) return DGFEM_ERROR_DEGENERATE;
    return inside || !gradients ? DGFEM_OK : DGFEM_ERROR_DEGENERATE;
}

/* ==== mesh.c ====================================================================================================== */

/* The complex of nodes, faces and elements: storage, access, measures, changes, compacting.

   All faces are planar to round-off: what would be bent is divided into triangles. So a face may be triangulated anew,
   when it gets a node on one of its edges, without any volume passing from one side to the other.

   Faces, elements and triangles are ranges of three pools. A change appends the new range behind the old ones and marks
   what it replaces as dead (face: owner[0] == DGFEM_NONE, element: face_count == 0); dgfem_mvci_mesh_compact removes
   what is dead or no longer used. Appending may move the arrays: hold indices, not pointers, across it. */

typedef struct dgfem_mvci_ints {
    int *data;
    int count, capacity;
} dgfem_mvci_ints;

typedef struct dgfem_mvci_face {
    int owner[2];                 /* [1] is DGFEM_NONE on the boundary */
    int loop, count;              /* range of mesh->loops; counter-clockwise seen from outside of owner[0] */
    int triangle, triangle_count; /* range of mesh->triangles, in triples oriented as the loop; count 0: not yet made */
    int from;                     /* face that it was, or was part of, at dgfem_mvci_mesh_begin; or DGFEM_NONE */
    int wall;                     /* 1: made by a cut */
} dgfem_mvci_face;

typedef struct dgfem_mvci_element {
    int face, face_count; /* range of mesh->element_faces */
    int from;             /* element that it was, or was part of, at dgfem_mvci_mesh_begin */
    int changed;          /* since then: to be integrated anew */
} dgfem_mvci_element;

/* Up to four nodes that a node was made from. Numbers are those of nodes at dgfem_mvci_mesh_begin, followed by those of
   all nodes made since, in the order in which they were made. */
typedef struct dgfem_mvci_birth {
    int parent[4]; /* or DGFEM_NONE */
} dgfem_mvci_birth;

typedef struct dgfem_mvci_mesh {
    int node_count, node_capacity, face_count, face_capacity, element_count, element_capacity;
    dgfem_vec3 *rest, *position, *velocity; /* [node_count] */
    int *origin;                            /* [node_count] number as in dgfem_mvci_birth */
    dgfem_mvci_face *faces;
    dgfem_mvci_element *elements;
    dgfem_mvci_ints loops;         /* nodes; hanging ones are in the loops of all faces that have their edge */
    dgfem_mvci_ints triangles;     /* three nodes each */
    dgfem_mvci_ints element_faces; /* 2 * face + side; side 1: the element is the face's owner[1] */
    int base_count;                /* nodes at dgfem_mvci_mesh_begin */
    int birth_count, birth_capacity;
    dgfem_mvci_birth *births; /* of number base_count + i */
    dgfem_hooks hooks;
} dgfem_mvci_mesh;

/* ---- access ---- */

static const int *dgfem_mvci_face_loop(const dgfem_mvci_mesh *mesh, int face, int *count) {
    *count = mesh->faces[face].count;
    return mesh->loops.data + mesh->faces[face].loop;
}

/* Triples of nodes; *count is the number of triangles. */
static const int *dgfem_mvci_face_triangles(const dgfem_mvci_mesh *mesh, int face, int *count) {
    *count = mesh->faces[face].triangle_count;
    return mesh->triangles.data + mesh->faces[face].triangle;
}

/* 2 * face + side each. */
static const int *dgfem_mvci_element_faces(const dgfem_mvci_mesh *mesh, int element, int *count) {
    *count = mesh->elements[element].face_count;
    return mesh->element_faces.data + mesh->elements[element].face;
}

/* Writes the distinct nodes of an element in the order of their first use; returns their number. mark[node_count] holds
   `element` nowhere before and at those nodes after the call, so that one array serves all elements in turn. */
static int dgfem_mvci_element_nodes(const dgfem_mvci_mesh *mesh, int element, int *mark, int *nodes) {
    int face_count, node_count = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            if (mark[loop[i]] == element) continue;
            mark[loop[i]] = element;
            nodes[node_count++] = loop[i];
        }
    }
    return node_count;
}

/* Number of corners of an element's faces: room for its nodes, and more than its triangles. */
static int dgfem_mvci_element_corners(const dgfem_mvci_mesh *mesh, int element) {
    int face_count, sum = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++) sum += mesh->faces[faces[k] / 2].count;
    return sum;
}

static int dgfem_mvci_max_element_corners(const dgfem_mvci_mesh *mesh) {
    int most = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        int corners = dgfem_mvci_element_corners(mesh, e);
        if (corners > most) most = corners;
    }
    return most;
}

/* Triangle t of a face as seen from outside of one of its sides. */
static void dgfem_mvci_triangle(const dgfem_mvci_mesh *mesh, int face, int side, int t, int nodes[3]) {
    const int *triangle = mesh->triangles.data + mesh->faces[face].triangle + 3 * t;
    nodes[0] = triangle[0];
    nodes[1] = triangle[side ? 2 : 1];
    nodes[2] = triangle[side ? 1 : 2];
}

/* Writes all triangles of an element, three nodes each, counter-clockwise from its outside; returns their number. */
static int dgfem_mvci_element_triangles(const dgfem_mvci_mesh *mesh, int element, int *triangles) {
    int face_count, written = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++)
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, triangles + 3 * written++);
    return written;
}

/* ---- measures at rest ---- */

/* Six times the volume of the tetrahedron of a triangle, counter-clockwise from outside, and a point inside. From the
   triangle's own sides: products of the corners' distances from the point would lose a small triangle in round-off. */
static dgfem_real dgfem_mvci_tetrahedron(const dgfem_mvci_mesh *mesh, const int nodes[3], dgfem_vec3 centre) {
    dgfem_vec3 a = mesh->rest[nodes[0]];
    dgfem_vec3 b = dgfem_mvci_sub(mesh->rest[nodes[1]], a), c = dgfem_mvci_sub(mesh->rest[nodes[2]], a);
    return dgfem_mvci_dot(dgfem_mvci_cross(b, c), dgfem_mvci_sub(a, centre));
}

/* Volume, and the centroid of the volume. */
static dgfem_real dgfem_mvci_element_measure(const dgfem_mvci_mesh *mesh, int element, dgfem_vec3 *centre) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_vec3 start = mesh->rest[mesh->loops.data[mesh->faces[faces[0] / 2].loop]], sum = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real volume = 0;
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real v = dgfem_mvci_tetrahedron(mesh, nodes, start);
            volume += v;
            for (int i = 0; i < 3; i++) sum = dgfem_mvci_axpy(sum, v, dgfem_mvci_sub(mesh->rest[nodes[i]], start));
        }
    *centre = volume > 0 ? dgfem_mvci_axpy(start, 1 / (4 * volume), sum) : start;
    return volume / 6;
}

/* Smallest volume of the tetrahedra of an element's triangles and a point: positive where the point sees all of them.
   *face (may be NULL) is the triangle's. */
static dgfem_real dgfem_mvci_element_star(const dgfem_mvci_mesh *mesh, int element, dgfem_vec3 centre, int *face) {
    int face_count, nodes[3], found = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_real smallest = 0;
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real v = dgfem_mvci_tetrahedron(mesh, nodes, centre) / 6;
            if (found && !(v < smallest)) continue;
            found = 1, smallest = v;
            if (face) *face = faces[k] / 2;
        }
    return smallest;
}

/* Twice the vector area of a loop. */
static dgfem_vec3 dgfem_mvci_loop_area(const dgfem_vec3 *x, const int *loop, int count) {
    dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 2; i < count; i++)
        sum = dgfem_mvci_add(
            sum, dgfem_mvci_cross(dgfem_mvci_sub(x[loop[i - 1]], x[loop[0]]), dgfem_mvci_sub(x[loop[i]], x[loop[0]])));
    return sum;
}

static dgfem_real dgfem_mvci_distance(dgfem_vec3 a, dgfem_vec3 b) { return dgfem_mvci_norm(dgfem_mvci_sub(a, b)); }

/* Sum of the areas of an element's triangles, and the largest distance of two of its corners. */
static dgfem_real dgfem_mvci_element_area(const dgfem_mvci_mesh *mesh, int element, dgfem_real *diameter) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_real area = 0, square = 0;
    for (int k = 0; k < face_count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[faces[k] / 2];
        for (int t = 0; t < face->triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, 0, t, nodes);
            area += dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, nodes, 3)) / 2;
        }
        for (int i = 0; i < face->count; i++)
            for (int l = k; l < face_count; l++) {
                const dgfem_mvci_face *other = &mesh->faces[faces[l] / 2];
                for (int j = 0; j < other->count; j++) {
                    dgfem_vec3 d = dgfem_mvci_sub(mesh->rest[mesh->loops.data[face->loop + i]],
                                                  mesh->rest[mesh->loops.data[other->loop + j]]);
                    square = dgfem_mvci_max(square, dgfem_mvci_dot(d, d));
                }
            }
    }
    *diameter = dgfem_mvci_sqrt(square);
    return area;
}

/* 3 V / (surface * diameter). */
static dgfem_real dgfem_mvci_element_quality(const dgfem_mvci_mesh *mesh, int element) {
    dgfem_vec3 centre;
    dgfem_real diameter, volume = dgfem_mvci_element_measure(mesh, element, &centre);
    dgfem_real area = dgfem_mvci_element_area(mesh, element, &diameter);
    return area > 0 ? 3 * volume / (area * diameter) : 0;
}

static dgfem_real dgfem_mvci_mesh_volume(const dgfem_mvci_mesh *mesh) {
    dgfem_real sum = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 centre;
        if (mesh->elements[e].face_count) sum += dgfem_mvci_element_measure(mesh, e, &centre);
    }
    return sum;
}

/* ---- memory ---- */

/* Makes *data hold `extra` more items. 1 on success; on failure 0, and nothing has changed. */
static int dgfem_mvci_room(const dgfem_hooks *hooks, void **data, int count, int *capacity, int extra, size_t size) {
    if (extra > INT_MAX - count) return 0;
    if (count + extra <= *capacity) return 1;
    int wanted = *capacity < INT_MAX / 2 ? 2 * *capacity : INT_MAX;
    if (wanted < count + extra) wanted = count + extra;
    if (wanted < 16) wanted = 16;
    void *grown = dgfem_mvci_reallocate(hooks, *data, (size_t)wanted, size);
    if (!grown) return 0;
    *data = grown;
    *capacity = wanted;
    return 1;
}

static int dgfem_mvci_ints_room(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int extra) {
    void *data = ints->data;
    int ok = dgfem_mvci_room(hooks, &data, ints->count, &ints->capacity, extra, sizeof(int));
    ints->data = (int *)data;
    return ok;
}

static int dgfem_mvci_push(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int value) {
    if (!dgfem_mvci_ints_room(hooks, ints, 1)) return 0;
    ints->data[ints->count++] = value;
    return 1;
}

/* Start of the copy, or DGFEM_NONE when out of memory. `source` must not lie in the pool. */
static int dgfem_mvci_append(const dgfem_hooks *hooks, dgfem_mvci_ints *pool, const int *source, int count) {
    if (!dgfem_mvci_ints_room(hooks, pool, count)) return DGFEM_NONE;
    if (count) memcpy(pool->data + pool->count, source, (size_t)count * sizeof(int));
    pool->count += count;
    return pool->count - count;
}

static void dgfem_mvci_mesh_destroy(dgfem_mvci_mesh *mesh) {
    if (!mesh) return;
    dgfem_hooks hooks = mesh->hooks;
    dgfem_mvci_free(&hooks, mesh->rest);
    dgfem_mvci_free(&hooks, mesh->position);
    dgfem_mvci_free(&hooks, mesh->velocity);
    dgfem_mvci_free(&hooks, mesh->origin);
    dgfem_mvci_free(&hooks, mesh->faces);
    dgfem_mvci_free(&hooks, mesh->elements);
    dgfem_mvci_free(&hooks, mesh->loops.data);
    dgfem_mvci_free(&hooks, mesh->triangles.data);
    dgfem_mvci_free(&hooks, mesh->element_faces.data);
    dgfem_mvci_free(&hooks, mesh->births);
    dgfem_mvci_free(&hooks, mesh);
}

static dgfem_mvci_mesh *dgfem_mvci_mesh_new(const dgfem_hooks *hooks) {
    dgfem_mvci_mesh *mesh = (dgfem_mvci_mesh *)dgfem_mvci_allocate(hooks, 1, sizeof *mesh);
    if (mesh) mesh->hooks = *hooks;
    return mesh;
}

static int dgfem_mvci_ints_copy(const dgfem_hooks *hooks, const dgfem_mvci_ints *from, dgfem_mvci_ints *to) {
    to->count = to->capacity = from->count;
    to->data = (int *)dgfem_mvci_duplicate(hooks, from->data, (size_t)from->count, sizeof(int));
    return to->data != NULL;
}

/* NULL when out of memory. */
static dgfem_mvci_mesh *dgfem_mvci_mesh_copy(const dgfem_mvci_mesh *mesh) {
    const dgfem_hooks *hooks = &mesh->hooks;
    dgfem_mvci_mesh *copy = dgfem_mvci_mesh_new(hooks);
    size_t nodes = (size_t)mesh->node_count;
    if (!copy) return NULL;
    copy->node_count = copy->node_capacity = mesh->node_count;
    copy->face_count = copy->face_capacity = mesh->face_count;
    copy->element_count = copy->element_capacity = mesh->element_count;
    copy->base_count = mesh->base_count;
    copy->birth_count = copy->birth_capacity = mesh->birth_count;
    copy->rest = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->rest, nodes, sizeof(dgfem_vec3));
    copy->position = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->position, nodes, sizeof(dgfem_vec3));
    copy->velocity = (dgfem_vec3 *)dgfem_mvci_duplicate(hooks, mesh->velocity, nodes, sizeof(dgfem_vec3));
    copy->origin = (int *)dgfem_mvci_duplicate(hooks, mesh->origin, nodes, sizeof(int));
    copy->faces =
        (dgfem_mvci_face *)dgfem_mvci_duplicate(hooks, mesh->faces, (size_t)mesh->face_count, sizeof *mesh->faces);
    copy->elements = (dgfem_mvci_element *)dgfem_mvci_duplicate(hooks, mesh->elements, (size_t)mesh->element_count,
                                                                sizeof *mesh->elements);
    copy->births =
        (dgfem_mvci_birth *)dgfem_mvci_duplicate(hooks, mesh->births, (size_t)mesh->birth_count, sizeof *mesh->births);
    if (copy->rest && copy->position && copy->velocity && copy->origin && copy->faces && copy->elements &&
        copy->births && dgfem_mvci_ints_copy(hooks, &mesh->loops, &copy->loops) &&
        dgfem_mvci_ints_copy(hooks, &mesh->triangles, &copy->triangles) &&
        dgfem_mvci_ints_copy(hooks, &mesh->element_faces, &copy->element_faces))
        return copy;
    dgfem_mvci_mesh_destroy(copy);
    return NULL;
}

/* ---- classes and lists ---- */

/* The root of the class of i, which is its own parent. */
static int dgfem_mvci_root(int *parent, int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Makes the classes of a and b one, with the lower root. */
static void dgfem_mvci_join(int *parent, int a, int b) {
    a = dgfem_mvci_root(parent, a), b = dgfem_mvci_root(parent, b);
    if (a < b) parent[b] = a;
    else parent[a] = b;
}

/* Lists the places of each key, ascending: list[start[k]] up to list[start[k + 1] - 1]. DGFEM_NONE is no key.
   start[keys + 1] comes zeroed. */
static void dgfem_mvci_list_places(const int *key, int count, int keys, int *start, int *list) {
    for (int i = 0; i < count; i++)
        if (key[i] != DGFEM_NONE) start[key[i] + 1]++;
    for (int k = 0; k < keys; k++) start[k + 1] += start[k];
    int total = start[keys];
    for (int i = count - 1; i >= 0; i--)
        if (key[i] != DGFEM_NONE) list[--start[key[i] + 1]] = i;
    for (int k = 0; k < keys; k++) start[k] = start[k + 1]; /* each has come down to its beginning */
    start[keys] = total;
}

/* ---- edges ---- */

/* Open addressing from a pair of nodes to a value. Zeroed memory is a table without room. */
typedef struct dgfem_mvci_edge {
    int a, b, value;
    unsigned stamp; /* used where it is that of the table */
} dgfem_mvci_edge;

typedef struct dgfem_mvci_edges {
    dgfem_mvci_edge *slots;
    size_t size; /* a power of two */
    unsigned stamp;
} dgfem_mvci_edges;

/* Empties the table and makes room for so many pairs. 0 when out of memory. */
static int dgfem_mvci_edges_reset(const dgfem_hooks *hooks, dgfem_mvci_edges *edges, int pairs) {
    size_t size = 16;
    while (size < 2 * (size_t)pairs) size *= 2;
    if (size > edges->size || edges->stamp == UINT_MAX) {
        dgfem_mvci_free(hooks, edges->slots);
        edges->size = 0;
        edges->slots = (dgfem_mvci_edge *)dgfem_mvci_allocate(hooks, size, sizeof *edges->slots);
        if (!edges->slots) return 0;
        edges->size = size;
        edges->stamp = 0;
    }
    edges->stamp++;
    return 1;
}

/* The pair's slot; a new one has the value DGFEM_NONE. */
static dgfem_mvci_edge *dgfem_mvci_edges_at(dgfem_mvci_edges *edges, int a, int b) {
    uint64_t key = (uint64_t)(uint32_t)a << 32 | (uint32_t)b;
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & (edges->size - 1);; slot = (slot + 1) & (edges->size - 1)) {
        dgfem_mvci_edge *edge = &edges->slots[slot];
        if (edge->stamp != edges->stamp) {
            edge->a = a, edge->b = b, edge->value = DGFEM_NONE;
            edge->stamp = edges->stamp;
            return edge;
        }
        if (edge->a == a && edge->b == b) return edge;
    }
}

/* The value of a pair, DGFEM_NONE where it is not in the table. */
static int dgfem_mvci_edges_find(const dgfem_mvci_edges *edges, int a, int b) {
    uint64_t key = (uint64_t)(uint32_t)a << 32 | (uint32_t)b;
    key = (key ^ key >> 31) * 0x9e3779b97f4a7c15u;
    for (size_t slot = (size_t)(key >> 24) & (edges->size - 1);; slot = (slot + 1) & (edges->size - 1)) {
        const dgfem_mvci_edge *edge = &edges->slots[slot];
        if (edge->stamp != edges->stamp) return DGFEM_NONE;
        if (edge->a == a && edge->b == b) return edge->value;
    }
}

/* The same for an edge either way. */
static dgfem_mvci_edge *dgfem_mvci_edges_between(dgfem_mvci_edges *edges, int a, int b) {
    return dgfem_mvci_edges_at(edges, a < b ? a : b, a < b ? b : a);
}
static int dgfem_mvci_edges_find_between(const dgfem_mvci_edges *edges, int a, int b) {
    return dgfem_mvci_edges_find(edges, a < b ? a : b, a < b ? b : a);
}

/* ---- changes: 0 or DGFEM_NONE when out of memory, and then the mesh may only be destroyed ---- */

static int dgfem_mvci_mesh_node_room(dgfem_mvci_mesh *mesh, int extra) {
    const dgfem_hooks *hooks = &mesh->hooks;
    void *data[4];
    int ok = 1, capacity = mesh->node_capacity;
    data[0] = mesh->rest, data[1] = mesh->position, data[2] = mesh->velocity, data[3] = mesh->origin;
    for (int i = 0; i < 4 && ok; i++) {
        capacity = mesh->node_capacity;
        ok = dgfem_mvci_room(hooks, &data[i], mesh->node_count, &capacity, extra,
                             i < 3 ? sizeof(dgfem_vec3) : sizeof(int));
    }
    mesh->rest = (dgfem_vec3 *)data[0], mesh->position = (dgfem_vec3 *)data[1];
    mesh->velocity = (dgfem_vec3 *)data[2], mesh->origin = (int *)data[3];
    if (ok) mesh->node_capacity = capacity;
    return ok;
}

/* A node between `count` others (at most four) with weights that sum to 1. Returns its index. */
static int dgfem_mvci_add_node(dgfem_mvci_mesh *mesh, const int *parents, const dgfem_real *weights, int count) {
    dgfem_vec3 zero = dgfem_mvci_vec3(0, 0, 0);
    void *births = mesh->births;
    DGFEM_ASSERT(count <= 4);
    if (!dgfem_mvci_mesh_node_room(mesh, 1)) return DGFEM_NONE;
    int ok = dgfem_mvci_room(&mesh->hooks, &births, mesh->birth_count, &mesh->birth_capacity, 1, sizeof *mesh->births);
    mesh->births = (dgfem_mvci_birth *)births;
    if (!ok) return DGFEM_NONE;
    int node = mesh->node_count++;
    dgfem_mvci_birth *birth = &mesh->births[mesh->birth_count];
    mesh->rest[node] = mesh->position[node] = mesh->velocity[node] = zero;
    mesh->origin[node] = mesh->base_count + mesh->birth_count++;
    for (int i = 0; i < 4; i++) {
        birth->parent[i] = i < count ? mesh->origin[parents[i]] : DGFEM_NONE;
        if (i >= count) continue;
        mesh->rest[node] = dgfem_mvci_axpy(mesh->rest[node], weights[i], mesh->rest[parents[i]]);
        mesh->position[node] = dgfem_mvci_axpy(mesh->position[node], weights[i], mesh->position[parents[i]]);
        mesh->velocity[node] = dgfem_mvci_axpy(mesh->velocity[node], weights[i], mesh->velocity[parents[i]]);
    }
    return node;
}

/* A node at (1 - t) a + t b. */
static int dgfem_mvci_add_node_between(dgfem_mvci_mesh *mesh, int a, int b, dgfem_real t) {
    int parents[2];
    dgfem_real weights[2];
    parents[0] = a, parents[1] = b;
    weights[0] = 1 - t, weights[1] = t;
    return dgfem_mvci_add_node(mesh, parents, weights, 2);
}

static int dgfem_mvci_copy_node(dgfem_mvci_mesh *mesh, int node) {
    dgfem_real one = 1;
    return dgfem_mvci_add_node(mesh, &node, &one, 1);
}

static void dgfem_mvci_touch_face(dgfem_mvci_mesh *mesh, int face) {
    for (int side = 0; side < 2; side++)
        if (mesh->faces[face].owner[side] != DGFEM_NONE) mesh->elements[mesh->faces[face].owner[side]].changed = 1;
}

/* Gives a face other nodes; it has no triangles then. `loop` must not lie in the pool. */
static int dgfem_mvci_set_loop(dgfem_mvci_mesh *mesh, int face, const int *loop, int count) {
    dgfem_mvci_face *f = &mesh->faces[face];
    if (count <= f->count) {
        memcpy(mesh->loops.data + f->loop, loop, (size_t)count * sizeof(int));
    } else {
        int start = dgfem_mvci_append(&mesh->hooks, &mesh->loops, loop, count);
        if (start == DGFEM_NONE) return 0;
        f->loop = start;
    }
    f->count = count;
    f->triangle_count = 0;
    dgfem_mvci_touch_face(mesh, face);
    return 1;
}

/* A new face, that its elements do not list yet. `loop` must not lie in the pool. Returns its index. */
static int dgfem_mvci_add_face(dgfem_mvci_mesh *mesh, int owner0, int owner1, const int *loop, int count, int from,
                               int wall) {
    void *faces = mesh->faces;
    int ok = dgfem_mvci_room(&mesh->hooks, &faces, mesh->face_count, &mesh->face_capacity, 1, sizeof *mesh->faces);
    mesh->faces = (dgfem_mvci_face *)faces;
    int start = ok ? dgfem_mvci_append(&mesh->hooks, &mesh->loops, loop, count) : DGFEM_NONE;
    if (start == DGFEM_NONE) return DGFEM_NONE;
    dgfem_mvci_face *face = &mesh->faces[mesh->face_count];
    face->owner[0] = owner0, face->owner[1] = owner1;
    face->loop = start, face->count = count;
    face->triangle = face->triangle_count = 0;
    face->from = from, face->wall = wall;
    dgfem_mvci_touch_face(mesh, mesh->face_count);
    return mesh->face_count++;
}

/* One more face of an element. */
static int dgfem_mvci_add_element_face(dgfem_mvci_mesh *mesh, int element, int face, int side) {
    dgfem_mvci_ints *pool = &mesh->element_faces;
    if (!dgfem_mvci_ints_room(&mesh->hooks, pool, mesh->elements[element].face_count + 1)) return 0;
    dgfem_mvci_element *e = &mesh->elements[element];
    if (e->face + e->face_count != pool->count) {
        memcpy(pool->data + pool->count, pool->data + e->face, (size_t)e->face_count * sizeof(int));
        e->face = pool->count;
        pool->count += e->face_count;
    }
    pool->data[pool->count++] = 2 * face + side;
    e->face_count++;
    e->changed = 1;
    return 1;
}

static void dgfem_mvci_remove_element_face(dgfem_mvci_mesh *mesh, int element, int face) {
    dgfem_mvci_element *e = &mesh->elements[element];
    int *list = mesh->element_faces.data + e->face, kept = 0;
    for (int k = 0; k < e->face_count; k++)
        if (list[k] / 2 != face) list[kept++] = list[k];
    e->face_count = kept;
    e->changed = 1;
}

/* Takes a face from its elements. */
static void dgfem_mvci_remove_face(dgfem_mvci_mesh *mesh, int face) {
    dgfem_mvci_face *f = &mesh->faces[face];
    for (int side = 0; side < 2; side++)
        if (f->owner[side] != DGFEM_NONE) dgfem_mvci_remove_element_face(mesh, f->owner[side], face);
    f->owner[0] = f->owner[1] = DGFEM_NONE;
}

/* An element without faces, a part of another. */
static int dgfem_mvci_add_element(dgfem_mvci_mesh *mesh, int from) {
    void *elements = mesh->elements;
    int ok = dgfem_mvci_room(&mesh->hooks, &elements, mesh->element_count, &mesh->element_capacity, 1,
                             sizeof *mesh->elements);
    mesh->elements = (dgfem_mvci_element *)elements;
    if (!ok) return DGFEM_NONE;
    dgfem_mvci_element *element = &mesh->elements[mesh->element_count];
    memset(element, 0, sizeof *element);
    element->from = from;
    element->changed = 1;
    return mesh->element_count++;
}

/* ---- history and compacting ---- */

/* From here on is recorded where nodes, faces and elements come from and what changes. */
static void dgfem_mvci_mesh_begin(dgfem_mvci_mesh *mesh) {
    mesh->base_count = mesh->node_count;
    mesh->birth_count = 0;
    for (int i = 0; i < mesh->node_count; i++) mesh->origin[i] = i;
    for (int f = 0; f < mesh->face_count; f++) mesh->faces[f].from = f;
    for (int e = 0; e < mesh->element_count; e++) mesh->elements[e].from = e, mesh->elements[e].changed = 0;
}

/* What nodes inherit from those at dgfem_mvci_mesh_begin: marked is each that has, or whose parents all have, a mark.
   mark[base_count + birth_count] comes with its first base_count members set; that of node i is then
   mark[origin[i]]. */
static void dgfem_mvci_mesh_inherit(const dgfem_mvci_mesh *mesh, char *mark) {
    for (int b = 0; b < mesh->birth_count; b++) {
        char all = 1;
        for (int i = 0; i < 4; i++)
            if (mesh->births[b].parent[i] != DGFEM_NONE && !mark[mesh->births[b].parent[i]]) all = 0;
        mark[mesh->base_count + b] = all;
    }
}

static void dgfem_mvci_compact_nodes(dgfem_mvci_mesh *mesh, int *number) {
    int kept = 0;
    for (int i = 0; i < mesh->node_count; i++) number[i] = DGFEM_NONE;
    for (int f = 0; f < mesh->face_count; f++) {
        int count = mesh->faces[f].owner[0] == DGFEM_NONE ? 0 : mesh->faces[f].count;
        for (int i = 0; i < count; i++) number[mesh->loops.data[mesh->faces[f].loop + i]] = 0;
    }
    for (int i = 0; i < mesh->node_count; i++) {
        if (number[i] == DGFEM_NONE) continue;
        mesh->rest[kept] = mesh->rest[i];
        mesh->position[kept] = mesh->position[i];
        mesh->velocity[kept] = mesh->velocity[i];
        mesh->origin[kept] = mesh->origin[i];
        number[i] = kept++;
    }
    mesh->node_count = kept;
}

static void dgfem_mvci_compact_elements(dgfem_mvci_mesh *mesh, int *number) {
    int kept = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        number[e] = mesh->elements[e].face_count ? kept : DGFEM_NONE;
        if (mesh->elements[e].face_count) mesh->elements[kept++] = mesh->elements[e];
    }
    mesh->element_count = kept;
}

/* The live faces, with their loops and triangles in order, into new pools. */
static void dgfem_mvci_compact_faces(dgfem_mvci_mesh *mesh, const int *node, const int *element, int *number,
                                     dgfem_mvci_ints *loops, dgfem_mvci_ints *triangles) {
    int kept = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        dgfem_mvci_face face = mesh->faces[f];
        number[f] = DGFEM_NONE;
        if (face.owner[0] == DGFEM_NONE) continue;
        int loop = loops->count, triangle = triangles->count;
        for (int i = 0; i < face.count; i++) loops->data[loops->count++] = node[mesh->loops.data[face.loop + i]];
        for (int i = 0; i < 3 * face.triangle_count; i++)
            triangles->data[triangles->count++] = node[mesh->triangles.data[face.triangle + i]];
        face.loop = loop, face.triangle = triangle;
        for (int side = 0; side < 2; side++)
            if (face.owner[side] != DGFEM_NONE) face.owner[side] = element[face.owner[side]];
        mesh->faces[kept] = face;
        number[f] = kept++;
    }
    mesh->face_count = kept;
}

/* Removes what is dead or unused; the rest keeps its order. 0 when out of memory, and nothing has changed. */
static int dgfem_mvci_mesh_compact(dgfem_mvci_mesh *mesh) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&mesh->hooks);
    dgfem_mvci_ints loops, triangles, lists;
    int *node = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int));
    int *face = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->face_count, sizeof(int));
    int *element = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->element_count, sizeof(int));
    memset(&loops, 0, sizeof loops);
    memset(&triangles, 0, sizeof triangles);
    memset(&lists, 0, sizeof lists);
    int ok = node && face && element && dgfem_mvci_ints_room(&mesh->hooks, &loops, mesh->loops.count) &&
             dgfem_mvci_ints_room(&mesh->hooks, &triangles, mesh->triangles.count) &&
             dgfem_mvci_ints_room(&mesh->hooks, &lists, mesh->element_faces.count);
    if (ok) {
        dgfem_mvci_compact_nodes(mesh, node);
        dgfem_mvci_compact_elements(mesh, element);
        dgfem_mvci_compact_faces(mesh, node, element, face, &loops, &triangles);
        for (int e = 0; e < mesh->element_count; e++) {
            dgfem_mvci_element *item = &mesh->elements[e];
            int start = lists.count;
            for (int k = 0; k < item->face_count; k++) {
                int entry = mesh->element_faces.data[item->face + k];
                lists.data[lists.count++] = 2 * face[entry / 2] + (entry & 1);
            }
            item->face = start;
        }
        dgfem_mvci_ints old[3];
        old[0] = mesh->loops, old[1] = mesh->triangles, old[2] = mesh->element_faces;
        mesh->loops = loops, mesh->triangles = triangles, mesh->element_faces = lists;
        loops = old[0], triangles = old[1], lists = old[2];
    }
    dgfem_mvci_free(&mesh->hooks, loops.data);
    dgfem_mvci_free(&mesh->hooks, triangles.data);
    dgfem_mvci_free(&mesh->hooks, lists.data);
    dgfem_mvci_scratch_free(&scratch);
    return ok;
}

/* ==== triangulate.c =============================================================================================== */

/* Triangles of faces, stored once for both sides.

   Ears are cut in the order of their smallest angles, the largest first, nodes of lower index first where they are
   equal: so the result depends on the face alone. Hanging nodes make collinear corners. An ear is refused where it is
   flat, where its diagonal meets another node (the trace would not conform there), and where it leaves only a line. */

/* Triangles lower than this part of their longest side are flat; so is what is within round-off. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_FLAT 1e-5
#else
#define DGFEM_MVC_FLAT 1e-9
#endif

/* Deviation from a plane, relative to the size of coordinates, that is taken for round-off. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_PLANAR 1e-5
#else
#define DGFEM_MVC_PLANAR 1e-11
#endif

typedef struct dgfem_mvci_polygon {
    double (*point)[2];
    int *node;
    int *left; /* indices of the corners not yet cut off, in order */
    int *triangles;
    int count, capacity;
    double flat; /* round-off of a height */
} dgfem_mvci_polygon;

static void dgfem_mvci_polygon_free(const dgfem_hooks *hooks, dgfem_mvci_polygon *polygon) {
    dgfem_mvci_free(hooks, polygon->point);
    dgfem_mvci_free(hooks, polygon->node);
    dgfem_mvci_free(hooks, polygon->left);
    dgfem_mvci_free(hooks, polygon->triangles);
}

static int dgfem_mvci_polygon_room(const dgfem_hooks *hooks, dgfem_mvci_polygon *polygon, int count) {
    if (count <= polygon->capacity) return 1;
    dgfem_mvci_polygon_free(hooks, polygon);
    polygon->capacity = 0;
    polygon->point = (double(*)[2])dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof *polygon->point);
    polygon->node = (int *)dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof(int));
    polygon->left = (int *)dgfem_mvci_allocate(hooks, 2 * (size_t)count, sizeof(int));
    polygon->triangles = (int *)dgfem_mvci_allocate(hooks, 6 * (size_t)count, sizeof(int));
    if (!polygon->point || !polygon->node || !polygon->left || !polygon->triangles) return 0;
    polygon->capacity = 2 * count;
    return 1;
}

/* Projects a loop along a unit normal. Returns how far its nodes are from a plane, relative to their coordinates. */
static double dgfem_mvci_polygon_project(const dgfem_mvci_mesh *mesh, const int *loop, int count, dgfem_vec3 normal,
                                         dgfem_mvci_polygon *polygon) {
    dgfem_vec3 start = mesh->rest[loop[0]], u, v;
    dgfem_real ax = dgfem_mvci_abs(normal.x), ay = dgfem_mvci_abs(normal.y), az = dgfem_mvci_abs(normal.z);
    double off = 0, reach = 0;
    u = dgfem_mvci_vec3(ax <= ay && ax <= az, ay < ax && ay <= az, az < ax && az < ay);
    u = dgfem_mvci_unit(dgfem_mvci_cross(u, normal));
    v = dgfem_mvci_cross(normal, u);
    for (int i = 0; i < count; i++) {
        dgfem_vec3 x = mesh->rest[loop[i]], d = dgfem_mvci_sub(x, start);
        double size = (double)dgfem_mvci_max(dgfem_mvci_norm(x), dgfem_mvci_norm(d));
        polygon->node[i] = loop[i];
        polygon->point[i][0] = (double)dgfem_mvci_dot(d, u);
        polygon->point[i][1] = (double)dgfem_mvci_dot(d, v);
        if (size > reach) reach = size;
    }
    for (int i = 0; i < count; i++) {
        double height = fabs((double)dgfem_mvci_dot(dgfem_mvci_sub(mesh->rest[loop[i]], start), normal));
        if (height > off) off = height;
    }
    polygon->count = count;
    polygon->flat = 16 * (double)DGFEM_MVC_EPSILON * reach;
    return reach > 0 ? off / reach : 0;
}

static double dgfem_mvci_turn(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static double dgfem_mvci_square(const double *a, const double *b) {
    return (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
}

/* Tangent of the smallest angle; not positive where the triangle is flat or turned over. */
static double dgfem_mvci_ear_angle(const double *a, const double *b, const double *c, double flat) {
    double l[3], area = dgfem_mvci_turn(a, b, c), sum, least, most;
    l[0] = dgfem_mvci_square(a, b), l[1] = dgfem_mvci_square(b, c), l[2] = dgfem_mvci_square(c, a);
    sum = l[0] + l[1] + l[2];
    least = l[0] < l[1] ? l[0] : l[1], most = l[0] > l[1] ? l[0] : l[1];
    if (l[2] < least) least = l[2];
    if (l[2] > most) most = l[2];
    if (!(area > DGFEM_MVC_FLAT * most + flat * sqrt(most))) return 0;
    return area / ((sum - 2 * least) / 2);
}

/* Whether no other corner lies in or on the ear at position k of those left. */
static int dgfem_mvci_ear_is_clear(const dgfem_mvci_polygon *polygon, int left, int k) {
    int previous = polygon->left[(k + left - 1) % left], next = polygon->left[(k + 1) % left];
    const double *a = polygon->point[previous], *b = polygon->point[polygon->left[k]], *c = polygon->point[next];
    double ab = sqrt(dgfem_mvci_square(a, b)), bc = sqrt(dgfem_mvci_square(b, c)), ca = sqrt(dgfem_mvci_square(c, a));
    for (int i = 2; i < left - 1; i++) {
        const double *p = polygon->point[polygon->left[(k + i) % left]];
        if (dgfem_mvci_turn(a, b, p) > -ab * (polygon->flat + DGFEM_MVC_FLAT * ab) &&
            dgfem_mvci_turn(b, c, p) > -bc * (polygon->flat + DGFEM_MVC_FLAT * bc) &&
            dgfem_mvci_turn(c, a, p) > -ca * (polygon->flat + DGFEM_MVC_FLAT * ca))
            return 0;
    }
    return 1;
}

/* Whether the corners left without the one at position k enclose an area. */
static int dgfem_mvci_ear_leaves_area(const dgfem_mvci_polygon *polygon, int left, int k) {
    const double *start = polygon->point[polygon->left[(k + 1) % left]];
    double area = 0, most = 0;
    for (int i = 2; i < left; i++) {
        const double *a = polygon->point[polygon->left[(k + i) % left]];
        double square = dgfem_mvci_square(start, a);
        if (square > most) most = square;
        if (i + 1 < left) area += dgfem_mvci_turn(start, a, polygon->point[polygon->left[(k + i + 1) % left]]);
    }
    return area > DGFEM_MVC_FLAT * most + polygon->flat * sqrt(most);
}

/* Position of the best ear of those left, or DGFEM_NONE. */
static int dgfem_mvci_best_ear(const dgfem_mvci_polygon *polygon, int left) {
    int best = DGFEM_NONE;
    double best_angle = 0;
    for (int k = 0; k < left; k++) {
        int i = polygon->left[k], previous = polygon->left[(k + left - 1) % left];
        double angle = dgfem_mvci_ear_angle(polygon->point[previous], polygon->point[i],
                                            polygon->point[polygon->left[(k + 1) % left]], polygon->flat);
        if (!(angle > 0) || angle < best_angle * (1 - 1e-6)) continue;
        if (angle <= best_angle * (1 + 1e-6) && polygon->node[i] > polygon->node[polygon->left[best]]) continue;
        if (!dgfem_mvci_ear_is_clear(polygon, left, k) || !dgfem_mvci_ear_leaves_area(polygon, left, k)) continue;
        best = k;
        best_angle = angle;
    }
    return best;
}

/* Fills polygon->triangles with nodes; returns their number, 0 where there is no good triangulation. */
static int dgfem_mvci_polygon_triangulate(dgfem_mvci_polygon *polygon) {
    int left = polygon->count, count = 0;
    for (int i = 0; i < left; i++) polygon->left[i] = i;
    while (left >= 3) {
        int k = left > 3 ? dgfem_mvci_best_ear(polygon, left) : 1, corner[3];
        if (k == DGFEM_NONE) return 0;
        corner[0] = polygon->left[(k + left - 1) % left];
        corner[1] = polygon->left[k];
        corner[2] = polygon->left[(k + 1) % left];
        if (!(dgfem_mvci_ear_angle(polygon->point[corner[0]], polygon->point[corner[1]], polygon->point[corner[2]],
                                   polygon->flat) > 0))
            return 0;
        for (int i = 0; i < 3; i++) polygon->triangles[3 * count + i] = polygon->node[corner[i]];
        count++;
        for (int i = k; i + 1 < left; i++) polygon->left[i] = polygon->left[i + 1];
        left--;
    }
    return count;
}

/* Makes the triangles of a face faces of their own; the first takes the place of the face. 0 when out of memory. */
static int dgfem_mvci_divide_face(dgfem_mvci_mesh *mesh, int face, const int *triangles, int count) {
    for (int t = 0; t < count; t++) {
        int index = face, start = dgfem_mvci_append(&mesh->hooks, &mesh->triangles, triangles + 3 * t, 3);
        if (start == DGFEM_NONE) return 0;
        if (t) {
            dgfem_mvci_face old = mesh->faces[face];
            index = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], triangles + 3 * t, 3, old.from, old.wall);
            if (index == DGFEM_NONE) return 0;
            for (int side = 0; side < 2; side++)
                if (old.owner[side] != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, old.owner[side], index, side))
                    return 0;
        } else if (!dgfem_mvci_set_loop(mesh, face, triangles, 3)) {
            return 0;
        }
        mesh->faces[index].triangle = start;
        mesh->faces[index].triangle_count = 1;
    }
    return 1;
}

/* Triangulates one face; divides it where it is bent. DGFEM_ERROR_DEGENERATE where it has no area, or no
   good triangles. */
static dgfem_status dgfem_mvci_settle_face(dgfem_mvci_mesh *mesh, int face, dgfem_mvci_polygon *polygon) {
    int count = mesh->faces[face].count;
    if (!dgfem_mvci_polygon_room(&mesh->hooks, polygon, count)) return DGFEM_ERROR_MEMORY;
    const int *loop = mesh->loops.data + mesh->faces[face].loop;
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, count));
    double off = dgfem_mvci_polygon_project(mesh, loop, count, normal, polygon);
    int triangles = count < 3 ? 0 : dgfem_mvci_polygon_triangulate(polygon);
    if (!triangles) return DGFEM_ERROR_DEGENERATE;
    if (triangles > 1 && off > DGFEM_MVC_PLANAR)
        return dgfem_mvci_divide_face(mesh, face, polygon->triangles, triangles) ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    int start = dgfem_mvci_append(&mesh->hooks, &mesh->triangles, polygon->triangles, 3 * triangles);
    if (start == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
    mesh->faces[face].triangle = start;
    mesh->faces[face].triangle_count = triangles;
    return DGFEM_OK;
}

/* Triangulates all faces that have no triangles. DGFEM_ERROR_DEGENERATE: those named in `bad` (may be NULL) have none,
   the others do. */
static dgfem_status dgfem_mvci_mesh_settle(dgfem_mvci_mesh *mesh, dgfem_mvci_ints *bad) {
    dgfem_mvci_polygon polygon;
    dgfem_status status = DGFEM_OK;
    int faces = mesh->face_count, degenerate = 0;
    memset(&polygon, 0, sizeof polygon);
    for (int f = 0; f < faces && status != DGFEM_ERROR_MEMORY; f++) {
        if (mesh->faces[f].owner[0] == DGFEM_NONE || mesh->faces[f].triangle_count) continue;
        status = dgfem_mvci_settle_face(mesh, f, &polygon);
        if (status != DGFEM_ERROR_DEGENERATE) continue;
        degenerate = 1;
        if (bad && !dgfem_mvci_push(&mesh->hooks, bad, f)) status = DGFEM_ERROR_MEMORY;
    }
    dgfem_mvci_polygon_free(&mesh->hooks, &polygon);
    return status == DGFEM_ERROR_MEMORY ? status : degenerate ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* ==== build.c ===================================================================================================== */

/* From a cell complex to nodes, faces and elements; the check of all invariants. */

/* ---- from the cell complex ---- */

static dgfem_status dgfem_mvci_check_source(const dgfem_mesh *source, const dgfem_hooks *hooks) {
    for (int f = 0; f < source->face_count; f++) {
        const dgfem_face *face = &source->faces[f];
        if (face->loop_count != 1)
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT,
                                   "face %d of element %d has %d loops: holes must be cut open", f, face->element[0],
                                   face->loop_count);
    }
    for (int i = 0; i < source->vertex_count; i++)
        if (!dgfem_mvci_is_finite3(source->vertices[i]))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", i);
    return DGFEM_OK;
}

/* The loop of a face as nodes of one of its elements; at[] gives the element's node at each vertex. */
static void dgfem_mvci_source_loop(const dgfem_mesh *source, const dgfem_face *face, const int *at, int reversed,
                                   int *out) {
    const dgfem_loop *loop = &source->loops[face->loop_start];
    for (int i = 0; i < loop->count; i++)
        out[reversed ? loop->count - 1 - i : i] = at[source->loop_vertices[loop->start + i]];
}

/* Elements and their faces, in the order of the source; of faces that are cut, the side of element[1] is appended. */
static int dgfem_mvci_mesh_read(dgfem_mvci_mesh *mesh, const dgfem_mesh *source, const dgfem_corners *corners, int *at,
                                int *loop) {
    for (int e = 0; e < source->element_count; e++) {
        const dgfem_element *element = &source->elements[e];
        if (dgfem_mvci_add_element(mesh, e) == DGFEM_NONE) return 0;
        for (int i = corners->corner_start[e]; i < corners->corner_start[e + 1]; i++)
            at[corners->vertex[corners->corners[i]]] = corners->corners[i];
        for (int k = 0; k < element->face_count; k++) {
            int f = source->element_faces[element->face_start + k], side = source->faces[f].element[0] != e;
            const dgfem_face *face = &source->faces[f];
            int count = source->loops[face->loop_start].count, index = f;
            if (!side || face->cut) dgfem_mvci_source_loop(source, face, at, side, loop);
            if (!side && !dgfem_mvci_set_loop(mesh, f, loop, count)) return 0;
            if (!side) mesh->faces[f].owner[0] = e;
            if (side && !face->cut) mesh->faces[f].owner[1] = e;
            if (side && face->cut) index = dgfem_mvci_add_face(mesh, e, DGFEM_NONE, loop, count, DGFEM_NONE, 1);
            if (!side && face->cut) mesh->faces[f].wall = 1;
            if (index == DGFEM_NONE) return 0;
            if (!dgfem_mvci_add_element_face(mesh, e, index, side && !face->cut)) return 0;
        }
    }
    return 1;
}

static int dgfem_mvci_mesh_fill(dgfem_mvci_mesh *mesh, const dgfem_mesh *source, const dgfem_corners *corners,
                                dgfem_mvci_scratch *scratch) {
    int most = 0;
    for (int i = 0; i < source->loop_count; i++)
        if (source->loops[i].count > most) most = source->loops[i].count;
    int *at = (int *)dgfem_mvci_take(scratch, (size_t)source->vertex_count, sizeof(int));
    int *loop = (int *)dgfem_mvci_take(scratch, (size_t)most, sizeof(int));
    if (!at || !loop || !dgfem_mvci_mesh_node_room(mesh, corners->count)) return 0;
    mesh->node_count = corners->count;
    for (int i = 0; i < corners->count; i++) {
        mesh->rest[i] = mesh->position[i] = source->vertices[corners->vertex[i]];
        mesh->velocity[i] = dgfem_mvci_vec3(0, 0, 0);
    }
    for (int f = 0; f < source->face_count; f++)
        if (dgfem_mvci_add_face(mesh, DGFEM_NONE, DGFEM_NONE, loop, 0, f, 0) == DGFEM_NONE) return 0;
    return dgfem_mvci_mesh_read(mesh, source, corners, at, loop);
}

/* Elements must be star-shaped about their centroid. */
static dgfem_status dgfem_mvci_check_star(const dgfem_mvci_mesh *mesh, const dgfem_hooks *hooks,
                                          dgfem_status otherwise) {
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_vec3 centre;
        int face = DGFEM_NONE;
        dgfem_real volume = dgfem_mvci_element_measure(mesh, e, &centre);
        if (!(volume > 0)) return dgfem_mvci_fail(hooks, otherwise, "element %d has the volume %g", e, (double)volume);
        if (!(dgfem_mvci_element_star(mesh, e, centre, &face) > 0))
            return dgfem_mvci_fail(hooks, otherwise,
                                   "element %d is not star-shaped: its centroid does not see face %d from inside", e,
                                   face);
    }
    return DGFEM_OK;
}

/* Logs what it refuses. The source's hooks take care of its corners. */
static dgfem_status dgfem_mvci_mesh_create(const dgfem_mesh *source, const dgfem_hooks *hooks, dgfem_mvci_mesh **out) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(hooks);
    dgfem_corners *corners = NULL;
    dgfem_mvci_ints bad;
    dgfem_status status = dgfem_mvci_check_source(source, hooks);
    *out = NULL;
    if (!status) status = dgfem_mesh_corners(source, &corners);
    if (status) return status;
    memset(&bad, 0, sizeof bad);
    dgfem_mvci_mesh *mesh = dgfem_mvci_mesh_new(hooks);
    if (!mesh || !dgfem_mvci_mesh_fill(mesh, source, corners, &scratch)) status = DGFEM_ERROR_MEMORY;
    if (!status) status = dgfem_mvci_mesh_settle(mesh, &bad);
    if (!status && !dgfem_mvci_mesh_compact(mesh)) status = DGFEM_ERROR_MEMORY;
    if (status == DGFEM_ERROR_MEMORY) (void)dgfem_mvci_fail_memory(hooks);
    if (status == DGFEM_ERROR_DEGENERATE)
        (void)dgfem_mvci_fail(hooks, status, "face %d has no area, or corners too close to its other sides",
                              bad.data[0]);
    if (!status) status = dgfem_mvci_check_star(mesh, hooks, DGFEM_ERROR_DEGENERATE);
    dgfem_corners_destroy(corners);
    dgfem_mvci_free(hooks, bad.data);
    dgfem_mvci_scratch_free(&scratch);
    if (status) {
        dgfem_mvci_mesh_destroy(mesh);
        return status;
    }
    dgfem_mvci_mesh_begin(mesh);
    *out = mesh;
    return DGFEM_OK;
}

/* ---- the check ---- */

static dgfem_status dgfem_mvci_check_faces(const dgfem_mvci_mesh *mesh, int *listed) {
    const dgfem_hooks *hooks = &mesh->hooks;
    const dgfem_status broken = DGFEM_ERROR_INVARIANT;
    for (int f = 0; f < mesh->face_count; f++) {
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] < 0 || face->owner[0] >= mesh->element_count || face->owner[1] < DGFEM_NONE ||
            face->owner[1] >= mesh->element_count || face->owner[0] == face->owner[1])
            return dgfem_mvci_fail(hooks, broken, "face %d has the elements %d and %d", f, face->owner[0],
                                   face->owner[1]);
        if (face->count < 3 || face->triangle_count != face->count - 2)
            return dgfem_mvci_fail(hooks, broken, "face %d of %d nodes has %d triangles", f, face->count,
                                   face->triangle_count);
        for (int i = 0; i < face->count; i++) {
            int node = mesh->loops.data[face->loop + i];
            if (node < 0 || node >= mesh->node_count)
                return dgfem_mvci_fail(hooks, broken, "face %d has the node %d", f, node);
        }
    }
    for (int e = 0; e < mesh->element_count; e++) {
        int count;
        const int *faces = dgfem_mvci_element_faces(mesh, e, &count);
        if (count < 4) return dgfem_mvci_fail(hooks, broken, "element %d has %d faces", e, count);
        for (int k = 0; k < count; k++) {
            if (faces[k] < 0 || faces[k] / 2 >= mesh->face_count || mesh->faces[faces[k] / 2].owner[faces[k] & 1] != e)
                return dgfem_mvci_fail(hooks, broken, "element %d is no element of its face %d", e, faces[k] / 2);
            listed[faces[k]]++;
        }
    }
    for (int f = 0; f < mesh->face_count; f++)
        if (listed[2 * f] != 1 || listed[2 * f + 1] != (mesh->faces[f].owner[1] != DGFEM_NONE))
            return dgfem_mvci_fail(hooks, broken, "face %d is listed %d and %d times by its elements", f, listed[2 * f],
                                   listed[2 * f + 1]);
    return DGFEM_OK;
}

/* No bent face, no flat triangle. */
static dgfem_status dgfem_mvci_check_shape(const dgfem_mvci_mesh *mesh, int f, dgfem_mvci_polygon *polygon) {
    const dgfem_mvci_face *face = &mesh->faces[f];
    if (!dgfem_mvci_polygon_room(&mesh->hooks, polygon, face->count)) return dgfem_mvci_fail_memory(&mesh->hooks);
    const int *loop = mesh->loops.data + face->loop;
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, face->count));
    double off = dgfem_mvci_polygon_project(mesh, loop, face->count, normal, polygon);
    if (face->count > 3 && !(off < 100 * DGFEM_MVC_PLANAR))
        return dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "face %d is bent by %g of its coordinates", f, off);
    for (int t = 0; t < face->triangle_count; t++) {
        int nodes[3];
        dgfem_mvci_triangle(mesh, f, 0, t, nodes);
        dgfem_vec3 area = dgfem_mvci_loop_area(mesh->rest, nodes, 3);
        double longest = 0, size = (double)dgfem_mvci_dot(area, normal);
        for (int i = 0; i < 3; i++) {
            double length = (double)dgfem_mvci_distance(mesh->rest[nodes[i]], mesh->rest[nodes[(i + 1) % 3]]);
            if (length > longest) longest = length;
        }
        if (!(size > DGFEM_MVC_FLAT / 2 * longest * longest))
            return dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "triangle %d of face %d is flat", t, f);
    }
    return DGFEM_OK;
}

/* Adds a directed edge of an element; 0 where it is there already. */
static int dgfem_mvci_check_edge(dgfem_mvci_edges *edges, int a, int b) {
    dgfem_mvci_edge *edge = dgfem_mvci_edges_at(edges, a, b);
    if (edge->value != DGFEM_NONE) return 0;
    edge->value = 0;
    return 1;
}

/* Each directed edge of loops, and of triangles, once and once the other way; a surface like a sphere. */
static dgfem_status dgfem_mvci_check_element(const dgfem_mvci_mesh *mesh, int e, dgfem_mvci_edges *edges, int *mark,
                                             int *nodes) {
    const dgfem_hooks *hooks = &mesh->hooks;
    int face_count, triangles = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, e, &face_count);
    for (int kind = 0; kind < 2; kind++) {
        if (!dgfem_mvci_edges_reset(hooks, edges, 3 * dgfem_mvci_element_corners(mesh, e)))
            return dgfem_mvci_fail_memory(hooks);
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < face_count; k++) {
                const dgfem_mvci_face *face = &mesh->faces[faces[k] / 2];
                int corners = kind ? 3 : face->count, parts = kind ? face->triangle_count : 1;
                const int *corner = kind ? mesh->triangles.data + face->triangle : mesh->loops.data + face->loop;
                for (int i = 0; i < parts * corners; i++) {
                    int a = corner[i], b = corner[i + 1 - ((i + 1) % corners ? 0 : corners)];
                    int forward = !(faces[k] & 1) == !pass; /* the second pass looks for the opposites */
                    int from = forward ? a : b, to = forward ? b : a;
                    if (pass ? dgfem_mvci_edges_find(edges, from, to) == DGFEM_NONE
                             : !dgfem_mvci_check_edge(edges, from, to))
                        return dgfem_mvci_fail(hooks, DGFEM_ERROR_INVARIANT,
                                               "element %d: the edge of nodes %d and %d in face %d %s", e, from, to,
                                               faces[k] / 2, pass ? "has no opposite" : "is there twice");
                }
                if (kind && !pass) triangles += face->triangle_count;
            }
    }
    int count = dgfem_mvci_element_nodes(mesh, e, mark, nodes);
    if (triangles != 2 * count - 4)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_INVARIANT, "element %d of %d nodes has %d triangles: not a ball", e,
                               count, triangles);
    return DGFEM_OK;
}

/* All invariants; DGFEM_ERROR_INVARIANT and a log line that names the offender. */
static dgfem_status dgfem_mvci_mesh_check(const dgfem_mvci_mesh *mesh) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&mesh->hooks);
    dgfem_mvci_edges edges;
    dgfem_mvci_polygon polygon;
    memset(&edges, 0, sizeof edges);
    memset(&polygon, 0, sizeof polygon);
    int *listed = (int *)dgfem_mvci_take(&scratch, 2 * (size_t)mesh->face_count, sizeof(int));
    int *mark = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int));
    dgfem_status status = listed && mark ? DGFEM_OK : dgfem_mvci_fail_memory(&mesh->hooks);
    if (!status) status = dgfem_mvci_check_faces(mesh, listed);
    int *nodes = NULL;
    if (!status) {
        nodes = (int *)dgfem_mvci_take(&scratch, (size_t)dgfem_mvci_max_element_corners(mesh), sizeof(int));
        if (!nodes) status = dgfem_mvci_fail_memory(&mesh->hooks);
    }
    for (int i = 0; !status && i < mesh->node_count; i++) mark[i] = DGFEM_NONE;
    for (int f = 0; !status && f < mesh->face_count; f++) status = dgfem_mvci_check_shape(mesh, f, &polygon);
    for (int e = 0; !status && e < mesh->element_count; e++)
        status = dgfem_mvci_check_element(mesh, e, &edges, mark, nodes);
    for (int i = 0; !status && i < mesh->node_count; i++)
        if (mark[i] == DGFEM_NONE || !dgfem_mvci_is_finite3(mesh->rest[i]))
            status = dgfem_mvci_fail(&mesh->hooks, DGFEM_ERROR_INVARIANT, "node %d is in no element or nowhere", i);
    if (!status) status = dgfem_mvci_check_star(mesh, &mesh->hooks, DGFEM_ERROR_INVARIANT);
    dgfem_mvci_free(&mesh->hooks, edges.slots);
    dgfem_mvci_polygon_free(&mesh->hooks, &polygon);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_check(const dgfem_mvc *body) {
    return body ? dgfem_mvci_mesh_check(body->mesh) : DGFEM_ERROR_ARGUMENT;
}

/* ==== element.c =================================================================================================== */

/* Integrals of one element: volume fractions, mean gradients, stiffness.

   Elements are star-shaped about their volume centroid c: each triangle f of their faces has a tetrahedron (f, c) of
   positive volume v_f. With kappa_f = v_f / V and mu_i = sum of v_f / (3 V) over the triangles of node i, masses mu_i
   rho V have the element's mass and centre of mass, eq. (18).

   Basis functions are linear on triangles, so that the divergence theorem gives the integral of a gradient exactly:
     V <grad phi_i> = sum over triangles (a, b, c) of node i of (x_b - x_a) x (x_c - x_a) / 6
   The corrected rules shift all samples of grad phi_i by one vector so that their sum agrees with it. Then stresses of
   linear fields are in balance across elements, which sampling alone spoils. */

/* An element while it is integrated. */
typedef struct dgfem_mvci_shape {
    int node_count, triangle_count;
    const int *nodes; /* [node_count] of the mesh */
    int *triangles;   /* indices of `nodes` */
    dgfem_vec3 *x;    /* [node_count] at rest */
    dgfem_vec3 centre;
    dgfem_real volume;
    dgfem_real *kappa; /* [triangle_count] */
    dgfem_real *mu;    /* [node_count] */
    dgfem_vec3 *mean;  /* [node_count] <grad phi_i> */
    int point_count;
    dgfem_real *phi;      /* [node_count] */
    dgfem_real *weight;   /* [points] sum to the volume */
    dgfem_vec3 *gradient; /* [points * node_count] */
    dgfem_real *basis;    /* [4 * node_count] orthonormal: 1, x, y, z at the nodes */
} dgfem_mvci_shape;

static int dgfem_mvci_point_count(dgfem_mvc_quadrature quadrature, int nodes, int triangles) {
    if (nodes == 4) return 1;
    return quadrature == DGFEM_MVC_TET4 ? 4 * triangles : nodes + triangles;
}

/* ---- measures ---- */

/* Volume fractions and mean gradients about the volume centroid. Returns the first triangle that does not see it from
   inside, or DGFEM_NONE. */
static int dgfem_mvci_measure_shape(dgfem_mvci_shape *shape) {
    memset(shape->mu, 0, (size_t)shape->node_count * sizeof *shape->mu);
    memset(shape->mean, 0, (size_t)shape->node_count * sizeof *shape->mean);
    for (int t = 0; t < shape->triangle_count; t++) {
        const int *at = shape->triangles + 3 * t;
        dgfem_vec3 origin = shape->x[at[0]];
        dgfem_vec3 normal =
            dgfem_mvci_cross(dgfem_mvci_sub(shape->x[at[1]], origin), dgfem_mvci_sub(shape->x[at[2]], origin));
        dgfem_real v = dgfem_mvci_dot(dgfem_mvci_sub(origin, shape->centre), normal) / 6;
        if (!(v > 0)) return t;
        shape->kappa[t] = v / shape->volume;
        for (int i = 0; i < 3; i++) {
            shape->mu[at[i]] += v / (3 * shape->volume);
            shape->mean[at[i]] = dgfem_mvci_axpy(shape->mean[at[i]], 1 / (6 * shape->volume), normal);
        }
    }
    return DGFEM_NONE;
}

/* ---- samples of gradients ---- */

static int dgfem_mvci_sample(dgfem_mvci_shape *shape, dgfem_vec3 x, dgfem_real weight) {
    dgfem_vec3 *gradient = shape->gradient + (size_t)shape->point_count * (size_t)shape->node_count;
    shape->weight[shape->point_count++] = weight;
    return dgfem_mvci_basis(shape->x, shape->node_count, shape->triangles, shape->triangle_count, x, shape->phi,
                            gradient);
}

static dgfem_vec3 dgfem_mvci_triangle_centre(const dgfem_mvci_shape *shape, int t) {
    const int *at = shape->triangles + 3 * t;
    dgfem_vec3 sum = dgfem_mvci_add(dgfem_mvci_add(shape->x[at[0]], shape->x[at[1]]), shape->x[at[2]]);
    return dgfem_mvci_scale(DGFEM_R(1.0 / 3), sum);
}

/* The four-point rule of degree 2 in each tetrahedron (f, c). */
static int dgfem_mvci_sample_tetrahedra(dgfem_mvci_shape *shape) {
    const dgfem_real near = DGFEM_R(0.5854101966249685), far = DGFEM_R(0.1381966011250105);
    int ok = 1;
    for (int t = 0; t < shape->triangle_count && ok; t++) {
        const int *at = shape->triangles + 3 * t;
        dgfem_real weight = shape->kappa[t] * shape->volume / 4;
        dgfem_vec3 sum = dgfem_mvci_scale(far, shape->centre);
        for (int i = 0; i < 3; i++) sum = dgfem_mvci_axpy(sum, far, shape->x[at[i]]);
        ok = dgfem_mvci_sample(shape, dgfem_mvci_axpy(sum, near - far, shape->centre), weight);
        for (int i = 0; i < 3 && ok; i++)
            ok = dgfem_mvci_sample(shape, dgfem_mvci_axpy(sum, near - far, shape->x[at[i]]), weight);
    }
    return ok;
}

/* Eq. (14) to (16), with the factor V_e that (16) lacks. */
static int dgfem_mvci_sample_paper(dgfem_mvci_shape *shape) {
    const dgfem_real half = shape->volume / 2;
    int ok = 1;
    for (int i = 0; i < shape->node_count && ok; i++)
        ok = dgfem_mvci_sample(shape, dgfem_mvci_blend(DGFEM_R(0.8), shape->x[i], DGFEM_R(0.2), shape->centre),
                               shape->mu[i] * half);
    for (int t = 0; t < shape->triangle_count && ok; t++) {
        dgfem_vec3 middle = dgfem_mvci_triangle_centre(shape, t);
        ok = dgfem_mvci_sample(shape, dgfem_mvci_blend(DGFEM_R(0.9), middle, DGFEM_R(0.1), shape->centre),
                               shape->kappa[t] * half);
    }
    return ok;
}

/* Makes the weighted mean of each node's samples its mean gradient. */
static void dgfem_mvci_correct(dgfem_mvci_shape *shape) {
    for (int i = 0; i < shape->node_count; i++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0), *gradient = shape->gradient + i;
        for (int q = 0; q < shape->point_count; q++)
            sum = dgfem_mvci_axpy(sum, shape->weight[q] / shape->volume, gradient[q * shape->node_count]);
        dgfem_vec3 shift = dgfem_mvci_sub(shape->mean[i], sum);
        for (int q = 0; q < shape->point_count; q++)
            gradient[q * shape->node_count] = dgfem_mvci_add(gradient[q * shape->node_count], shift);
    }
}

/* 0 where a sample falls on the surface: the element is degenerate. On tetrahedra gradients are constant. */
static int dgfem_mvci_sample_shape(dgfem_mvci_shape *shape, dgfem_mvc_quadrature quadrature) {
    shape->point_count = 0;
    if (shape->node_count == 4) {
        memcpy(shape->gradient, shape->mean, 4 * sizeof *shape->mean);
        shape->weight[shape->point_count++] = shape->volume;
        return 1;
    }
    int ok = quadrature == DGFEM_MVC_TET4 ? dgfem_mvci_sample_tetrahedra(shape) : dgfem_mvci_sample_paper(shape);
    if (ok && quadrature != DGFEM_MVC_PAPER_RAW) dgfem_mvci_correct(shape);
    return ok;
}

/* ---- stiffness ---- */

/* Lame's constants. */
static dgfem_real dgfem_mvci_shear(dgfem_material m) { return m.young / (2 * (1 + m.poisson)); }
static dgfem_real dgfem_mvci_lambda(dgfem_material m) {
    return m.young * m.poisson / ((1 + m.poisson) * (1 - 2 * m.poisson));
}

/* block += s u v^T, row-major. */
static void dgfem_mvci_add_block(dgfem_real *block, dgfem_real s, dgfem_vec3 u, dgfem_vec3 v) {
    dgfem_vec3 w = dgfem_mvci_scale(s, u);
    block[0] += w.x * v.x, block[1] += w.x * v.y, block[2] += w.x * v.z;
    block[3] += w.y * v.x, block[4] += w.y * v.y, block[5] += w.y * v.z;
    block[6] += w.z * v.x, block[7] += w.z * v.y, block[8] += w.z * v.z;
}

/* From A = integral of g_a g_b^T:  c A + mu (A^T + tr A I). c = lambda gives the stiffness; c = -2/3 mu that of the
   strain's deviator alone. */
static void dgfem_mvci_elastic_block(dgfem_real *block, dgfem_real c, dgfem_real mu) {
    dgfem_real a[9], trace = mu * (block[0] + block[4] + block[8]);
    memcpy(a, block, sizeof a);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) block[3 * i + j] = c * a[3 * i + j] + mu * a[3 * j + i];
    for (int i = 0; i < 9; i += 4) block[i] += trace;
}

/* Stiffness of a sampled shape: blocks (a, b), b <= a, one after the other. With b_bar the change of volume at each
   point is its mean in the element. */
static void dgfem_mvci_stiffness(const dgfem_mvci_shape *shape, dgfem_material material, int b_bar, dgfem_real *out) {
    dgfem_real mu = dgfem_mvci_shear(material), lambda = dgfem_mvci_lambda(material);
    dgfem_real bulk = b_bar ? lambda + 2 * mu / 3 : 0, c = b_bar ? -2 * mu / 3 : lambda;
    int n = shape->node_count;
    memset(out, 0, (size_t)n * ((size_t)n + 1) / 2 * 9 * sizeof *out);
    for (int q = 0; q < shape->point_count; q++) {
        const dgfem_vec3 *g = shape->gradient + (size_t)q * (size_t)n;
        dgfem_real *block = out;
        for (int a = 0; a < n; a++)
            for (int b = 0; b <= a; b++, block += 9) dgfem_mvci_add_block(block, shape->weight[q], g[a], g[b]);
    }
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, out += 9) {
            dgfem_mvci_elastic_block(out, c, mu);
            if (b_bar) dgfem_mvci_add_block(out, bulk * shape->volume, shape->mean[a], shape->mean[b]);
        }
}

/* Orthonormal vectors that span 1, x, y, z at the nodes. Gram-Schmidt, twice for round-off. */
static void dgfem_mvci_linear_span(dgfem_mvci_shape *shape) {
    int n = shape->node_count;
    for (int i = 0; i < n; i++) {
        dgfem_vec3 d = dgfem_mvci_sub(shape->x[i], shape->centre);
        shape->basis[i] = 1, shape->basis[n + i] = d.x, shape->basis[2 * n + i] = d.y, shape->basis[3 * n + i] = d.z;
    }
    for (int k = 0; k < 8; k++) {
        dgfem_real *v = shape->basis + (k / 2) * n, square = 0;
        for (const dgfem_real *u = shape->basis; u < v; u += n) {
            dgfem_real s = 0;
            for (int i = 0; i < n; i++) s += u[i] * v[i];
            for (int i = 0; i < n; i++) v[i] -= s * u[i];
        }
        for (int i = 0; i < n; i++) square += v[i] * v[i];
        for (int i = 0; i < n; i++) v[i] /= dgfem_mvci_sqrt(square);
    }
}

/* Adds factor (1 - Pi) (x) I, Pi the projection of nodal values to linear fields. */
static void dgfem_mvci_stabilise(dgfem_mvci_shape *shape, dgfem_real factor, dgfem_real *out) {
    int n = shape->node_count;
    if (n == 4) return;
    dgfem_mvci_linear_span(shape);
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, out += 9) {
            dgfem_real s = (dgfem_real)(a == b);
            for (int k = 0; k < 4; k++) s -= shape->basis[k * n + a] * shape->basis[k * n + b];
            for (int i = 0; i < 9; i += 4) out[i] += factor * s;
        }
}

/* ==== system.c ==================================================================================================== */

/* What follows from a mesh and materials: nodal masses, integrals of all elements, the block matrix and its solver. */

/* Vectors of all nodes that steps and solves work with. */
enum {
    DGFEM_MVCI_RHS,
    DGFEM_MVCI_SOLUTION,
    DGFEM_MVCI_FORCE,
    DGFEM_MVCI_TARGET, /* displacements of held axes */
    DGFEM_MVCI_VECTORS
};

/* A pair of an element's nodes as part of a block of the matrix. */
typedef struct dgfem_mvci_block_part {
    int element, pair;
    int turned; /* 1: transposed */
} dgfem_mvci_block_part;

struct dgfem_mvc_system {
    int *node_start;       /* [element_count + 1] into what elements have per node: */
    int *nodes;            /*   its nodes, in the order of the rows of its stiffness */
    dgfem_real *share;     /*   mu_i */
    dgfem_vec3 *mean;      /*   <grad phi_i> */
    size_t *pair_start;    /* [element_count + 1] into what elements have per pair of nodes (a, b), b <= a: */
    dgfem_real *stiffness; /*   9 numbers, row-major, at rest */
    int *use_start;        /* [node_count + 1] into `uses` */
    int *uses;             /* positions of each node in `nodes`, ascending */
    char *held;            /* [node_count] axes held */
    dgfem_mat3 *next;      /* [element_count] rotations that become the body's when a call succeeds */
    dgfem_vec3 *work;      /* DGFEM_MVCI_VECTORS * [node_count] */
    dgfem_vec3 *local;     /* displacements of elements by position in `nodes`, then forces */
    double factor_flops;   /* of the latest factorization, before the latest cut if need be; or 0 */

    /* NULL until dgfem_mvci_prepare_solver. */
    dgfem_matrix *matrix;
    int *places;                  /* without threads: block of each pair; */
    int *part_start;              /* with threads: [blocks of the matrix + 1] into `parts`, */
    dgfem_mvci_block_part *parts; /*   what each block is the sum of, in the order of elements */
    size_t *diagonal;             /* [node_count] place of the matrix's block */
    dgfem_cholesky *cholesky;     /* or, with PCG, */
    dgfem_real *pcg_work;
};

static dgfem_vec3 *dgfem_mvci_vector(const dgfem_mvc *body, int k) {
    return body->system->work + (size_t)k * (size_t)body->node_count;
}
static dgfem_real *dgfem_mvci_reals(dgfem_vec3 *x) { return (dgfem_real *)(void *)x; }

/* ---- the elements' nodes ---- */

/* Fills node_start, nodes, pair_start and makes room for the rest; *points is the largest number of samples times nodes
   of an element, *corners that of nodes or triangles. 0 when out of memory. */
static int dgfem_mvci_lay_out(const dgfem_mvc *body, dgfem_mvc_system *system, size_t *points, int *corners) {
    const dgfem_mvci_mesh *mesh = body->mesh;
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(hooks);
    size_t elements = (size_t)mesh->element_count;
    int *mark = (int *)dgfem_mvci_take(&scratch, (size_t)mesh->node_count, sizeof(int)), total = 0;
    *points = 0, *corners = dgfem_mvci_max_element_corners(mesh);
    for (int e = 0; e < mesh->element_count; e++) total += dgfem_mvci_element_corners(mesh, e);
    int *nodes = (int *)dgfem_mvci_take(&scratch, (size_t)total, sizeof(int));
    system->node_start = (int *)dgfem_mvci_allocate(hooks, elements + 1, sizeof(int));
    system->pair_start = (size_t *)dgfem_mvci_allocate(hooks, elements + 1, sizeof(size_t));
    int ok = mark && nodes && system->node_start && system->pair_start;
    for (int i = 0; ok && i < mesh->node_count; i++) mark[i] = DGFEM_NONE;
    for (int e = 0; ok && e < mesh->element_count; e++) {
        int start = system->node_start[e], face_count, triangles = 0;
        const int *faces = dgfem_mvci_element_faces(mesh, e, &face_count);
        for (int k = 0; k < face_count; k++) triangles += mesh->faces[faces[k] / 2].triangle_count;
        int count = dgfem_mvci_element_nodes(mesh, e, mark, nodes + start);
        size_t samples = (size_t)dgfem_mvci_point_count(body->desc.quadrature, count, triangles);
        if (samples * (size_t)count > *points) *points = samples * (size_t)count;
        system->node_start[e + 1] = start + count;
        system->pair_start[e + 1] = system->pair_start[e] + (size_t)count * ((size_t)count + 1) / 2;
    }
    if (ok) {
        size_t used = (size_t)system->node_start[elements];
        system->nodes = (int *)dgfem_mvci_duplicate(hooks, nodes, used, sizeof(int));
        system->share = (dgfem_real *)dgfem_mvci_allocate(hooks, used, sizeof(dgfem_real));
        system->mean = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, used, sizeof(dgfem_vec3));
        system->stiffness =
            (dgfem_real *)dgfem_mvci_allocate(hooks, system->pair_start[elements], 9 * sizeof(dgfem_real));
        system->local = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, 2 * used, sizeof(dgfem_vec3));
        system->use_start = (int *)dgfem_mvci_allocate(hooks, (size_t)mesh->node_count + 1, sizeof(int));
        system->uses = (int *)dgfem_mvci_allocate(hooks, used, sizeof(int));
        ok = system->nodes && system->share && system->mean && system->stiffness && system->local &&
             system->use_start && system->uses;
    }
    if (ok)
        dgfem_mvci_list_places(system->nodes, system->node_start[elements], mesh->node_count, system->use_start,
                               system->uses);
    dgfem_mvci_scratch_free(&scratch);
    return ok;
}

/* ---- integration ---- */

/* What the integration of any element needs. `index` gives the place of the mesh's nodes in the element. */
static int dgfem_mvci_shape_reserve(dgfem_mvci_scratch *scratch, int corners, size_t points, int node_count,
                                    dgfem_mvci_shape *shape, int **index) {
    size_t n = (size_t)corners;
    memset(shape, 0, sizeof *shape);
    shape->triangles = (int *)dgfem_mvci_take(scratch, 3 * n, sizeof(int));
    shape->x = (dgfem_vec3 *)dgfem_mvci_take(scratch, n, sizeof(dgfem_vec3));
    shape->kappa = (dgfem_real *)dgfem_mvci_take(scratch, n, sizeof(dgfem_real));
    shape->phi = (dgfem_real *)dgfem_mvci_take(scratch, n, sizeof(dgfem_real));
    shape->weight = (dgfem_real *)dgfem_mvci_take(scratch, 4 * n, sizeof(dgfem_real));
    shape->basis = (dgfem_real *)dgfem_mvci_take(scratch, 4 * n, sizeof(dgfem_real));
    shape->gradient = (dgfem_vec3 *)dgfem_mvci_take(scratch, points, sizeof(dgfem_vec3));
    *index = (int *)dgfem_mvci_take(scratch, (size_t)node_count, sizeof(int));
    return shape->triangles && shape->x && shape->kappa && shape->phi && shape->weight && shape->basis &&
           shape->gradient && *index;
}

/* Gathers element e. */
static void dgfem_mvci_shape_take(const dgfem_mvc *body, const dgfem_mvc_system *system, int e, int *index,
                                  dgfem_mvci_shape *shape) {
    int start = system->node_start[e];
    shape->node_count = system->node_start[e + 1] - start;
    shape->nodes = system->nodes + start;
    shape->mu = system->share + start;
    shape->mean = system->mean + start;
    for (int i = 0; i < shape->node_count; i++) {
        index[shape->nodes[i]] = i;
        shape->x[i] = body->mesh->rest[shape->nodes[i]];
    }
    shape->triangle_count = dgfem_mvci_element_triangles(body->mesh, e, shape->triangles);
    for (int i = 0; i < 3 * shape->triangle_count; i++) shape->triangles[i] = index[shape->triangles[i]];
    shape->volume = dgfem_mvci_element_measure(body->mesh, e, &shape->centre);
}

static dgfem_status dgfem_mvci_integrate_element(dgfem_mvc *body, dgfem_mvc_system *system, int e, int *index,
                                                 dgfem_mvci_shape *shape) {
    const dgfem_mvc_desc *desc = &body->desc;
    dgfem_real *stiffness = system->stiffness + 9 * system->pair_start[e];
    dgfem_mvci_shape_take(body, system, e, index, shape);
    int bad = shape->volume > 0 ? dgfem_mvci_measure_shape(shape) : 0;
    if (bad != DGFEM_NONE) {
        const int *at = shape->triangles + 3 * bad;
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_DEGENERATE,
                               "element %d (volume %g) is not star-shaped: its centroid is not behind the triangle of "
                               "nodes %d, %d, %d",
                               e, (double)shape->volume, shape->nodes[at[0]], shape->nodes[at[1]], shape->nodes[at[2]]);
    }
    if (!dgfem_mvci_sample_shape(shape, desc->quadrature))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_DEGENERATE, "element %d is too thin to be integrated", e);
    dgfem_mvci_stiffness(shape, body->material[e], desc->b_bar && shape->node_count > 4, stiffness);
    if (desc->stabilisation > 0)
        dgfem_mvci_stabilise(
            shape, desc->stabilisation * dgfem_mvci_shear(body->material[e]) * (dgfem_real)cbrt((double)shape->volume),
            stiffness);
    body->volume[e] = shape->volume;
    body->centre[e] = shape->centre;
    return DGFEM_OK;
}

/* An element that an edit has left as it was keeps its integrals. */
static void dgfem_mvci_keep_element(dgfem_mvc *body, dgfem_mvc_system *system, int e, const dgfem_mvc *before) {
    const dgfem_mvc_system *old = before->system;
    int from = body->mesh->elements[e].from, count = system->node_start[e + 1] - system->node_start[e];
    int to_start = system->node_start[e], from_start = old->node_start[from];
    size_t pairs = system->pair_start[e + 1] - system->pair_start[e];
    DGFEM_ASSERT(count == old->node_start[from + 1] - from_start);
    memcpy(system->share + to_start, old->share + from_start, (size_t)count * sizeof *system->share);
    memcpy(system->mean + to_start, old->mean + from_start, (size_t)count * sizeof *system->mean);
    memcpy(system->stiffness + 9 * system->pair_start[e], old->stiffness + 9 * old->pair_start[from],
           9 * pairs * sizeof *system->stiffness);
    body->volume[e] = before->volume[from];
    body->centre[e] = before->centre[from];
}

/* All elements; `before`: the body before an edit, or NULL. */
static dgfem_status dgfem_mvci_integrate(dgfem_mvc *body, dgfem_mvc_system *system, const dgfem_mvc *before,
                                         size_t points, int corners) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvci_shape shape;
    int *index;
    dgfem_status status = DGFEM_OK;
    if (!dgfem_mvci_shape_reserve(&scratch, corners, points, body->mesh->node_count, &shape, &index))
        status = dgfem_mvci_fail_memory(&body->hooks);
    for (int e = 0; !status && e < body->mesh->element_count; e++) {
        if (before && !body->mesh->elements[e].changed) dgfem_mvci_keep_element(body, system, e, before);
        else status = dgfem_mvci_integrate_element(body, system, e, index, &shape);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

/* ---- nodes ---- */

/* Masses, parts of the boundary, moduli for contact. */
static void dgfem_mvci_measure_nodes(dgfem_mvc *body, const dgfem_mvc_system *system) {
    const dgfem_mvci_mesh *mesh = body->mesh;
    for (int i = 0; i < mesh->node_count; i++) body->mass[i] = body->area[i] = body->modulus[i] = 0;
    for (int e = 0; e < mesh->element_count; e++) {
        dgfem_real radius = 0, mass = body->material[e].density * body->volume[e];
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
            radius = dgfem_mvci_max(radius, dgfem_mvci_distance(mesh->rest[system->nodes[i]], body->centre[e]));
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
            int node = system->nodes[i];
            body->mass[node] += system->share[i] * mass;
            body->modulus[node] += system->share[i] * body->volume[e] * body->material[e].young / radius;
            system->work[node].x += system->share[i] * body->volume[e];
        }
    }
    for (int i = 0; i < mesh->node_count; i++) body->modulus[i] /= system->work[i].x;
    for (int f = 0; f < mesh->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(mesh, f, &count);
        for (int t = 0; mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, at, 3)) / 6;
            for (int i = 0; i < 3; i++) body->area[at[i]] += area;
        }
    }
}

/* ---- matrix ---- */

/* The number of a block; all have nine values. */
static int dgfem_mvci_block_index(const dgfem_matrix *matrix, int row, int column) {
    return (int)((dgfem_matrix_block(matrix, row, column) - matrix->values) / 9);
}

/* Enters the block of each pair in places. Or counts the parts of each block in part_start[block + 1]; or, once these
   are beginnings, writes them there, and part_start[block + 1] moves on. */
static void dgfem_mvci_enter_parts(const dgfem_mvc *body, dgfem_mvc_system *system, int is_write) {
    int pair = 0;
    for (int e = 0; e < body->element_count; e++) {
        const int *nodes = system->nodes + system->node_start[e];
        int count = system->node_start[e + 1] - system->node_start[e];
        for (int a = 0; a < count; a++)
            for (int b = 0; b <= a; b++, pair++) {
                int turned = nodes[a] < nodes[b];
                int block = dgfem_mvci_block_index(system->matrix, nodes[turned ? b : a], nodes[turned ? a : b]);
                if (system->places) {
                    system->places[pair] = block;
                    continue;
                }
                int at = system->part_start[block + 1]++;
                if (!is_write) continue;
                system->parts[at].element = e;
                system->parts[at].pair = pair;
                system->parts[at].turned = turned;
            }
    }
}

static void dgfem_mvci_list_parts(const dgfem_mvc *body, dgfem_mvc_system *system, int blocks) {
    int *start = system->part_start, sum = 0;
    dgfem_mvci_enter_parts(body, system, 0);
    for (int k = 0; k < blocks; k++) { /* from counts to beginnings */
        int count = start[k + 1];
        start[k + 1] = sum;
        sum += count;
    }
    dgfem_mvci_enter_parts(body, system, 1);
}

/* places or parts, as the hooks ask, and diagonal. 0 when out of memory. */
static int dgfem_mvci_list_blocks(const dgfem_mvc *body, dgfem_mvc_system *system) {
    const dgfem_hooks *hooks = &body->hooks;
    const dgfem_matrix *matrix = system->matrix;
    size_t pairs = system->pair_start[body->element_count];
    int blocks = matrix->row_start[matrix->block_count];
    DGFEM_ASSERT(matrix->value_start[blocks] == 9 * (size_t)blocks);
    for (int i = 0; i < body->node_count; i++) system->diagonal[i] = 9 * (size_t)dgfem_mvci_block_index(matrix, i, i);
    if (!hooks->parallel_for) {
        system->places = (int *)dgfem_mvci_allocate(hooks, pairs, sizeof(int));
        if (system->places) dgfem_mvci_enter_parts(body, system, 0);
        return system->places != NULL;
    }
    system->part_start = (int *)dgfem_mvci_allocate(hooks, (size_t)blocks + 1, sizeof(int));
    system->parts = (dgfem_mvci_block_part *)dgfem_mvci_allocate(hooks, pairs, sizeof *system->parts);
    if (!system->part_start || !system->parts) return 0;
    dgfem_mvci_list_parts(body, system, blocks);
    return 1;
}

static dgfem_status dgfem_mvci_create_matrix(const dgfem_mvc *body, dgfem_mvc_system *system) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_matrix_desc desc = dgfem_default_matrix_desc();
    size_t pairs = system->pair_start[body->element_count];
    if (pairs > (size_t)INT_MAX / 2)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d elements are too many", body->element_count);
    int *sizes = (int *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof(int));
    int *list = (int *)dgfem_mvci_take(&scratch, 2 * pairs, sizeof(int)), *at = list;
    dgfem_status status = DGFEM_ERROR_MEMORY;
    if (sizes && list) {
        for (int i = 0; i < body->node_count; i++) sizes[i] = 3;
        for (int e = 0; e < body->element_count; e++)
            for (int a = system->node_start[e]; a < system->node_start[e + 1]; a++)
                for (int b = system->node_start[e]; b <= a; b++) *at++ = system->nodes[a], *at++ = system->nodes[b];
        desc.block_count = body->node_count;
        desc.block_sizes = sizes;
        desc.pairs = list;
        desc.pair_count = (int)pairs;
        desc.centres = body->mesh->rest;
        desc.hooks = body->hooks;
        desc.hooks.log = NULL; /* the body has its own line */
        status = dgfem_matrix_create(&desc, &system->matrix);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status ? dgfem_mvci_fail(&body->hooks, status, "the matrix of %d nodes", body->node_count) : DGFEM_OK;
}

/* Where factorizations are dear, a good order of elimination pays with the first of them. Otherwise a fair one that
   costs a tenth of it to find does as well: a body that is being cut is analysed often. */
static dgfem_ordering dgfem_mvci_choose_ordering(const dgfem_mvc *body, int is_cut) {
    const double dear = 2e9, per_node = 80; /* as measured in tetrahedra and their parts */
    double flops = body->system->factor_flops, nodes = (double)body->node_count;
    if (!(flops > 0)) flops = per_node * nodes * nodes;
    return is_cut && flops < dear ? DGFEM_ORDERING_MINIMUM_DEGREE : DGFEM_ORDERING_AUTO;
}

static void dgfem_mvci_free_solver(const dgfem_hooks *hooks, dgfem_mvc_system *system) {
    dgfem_mvci_free(hooks, system->part_start);
    dgfem_mvci_free(hooks, system->parts);
    dgfem_mvci_free(hooks, system->places);
    dgfem_mvci_free(hooks, system->diagonal);
    dgfem_mvci_free(hooks, system->pcg_work);
    dgfem_matrix_destroy(system->matrix);
    dgfem_cholesky_destroy(system->cholesky);
    system->part_start = NULL;
    system->parts = NULL;
    system->places = NULL;
    system->diagonal = NULL;
    system->pcg_work = NULL;
    system->matrix = NULL;
    system->cholesky = NULL;
}

static dgfem_status dgfem_mvci_create_solver(const dgfem_mvc *body, dgfem_mvc_system *system, int is_cut) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_cholesky_desc desc = dgfem_default_cholesky_desc();
    dgfem_status status = dgfem_mvci_create_matrix(body, system);
    if (status) return status;
    desc.ordering = dgfem_mvci_choose_ordering(body, is_cut);
    desc.hooks = *hooks;
    desc.hooks.log = NULL;
    if (body->desc.solver == DGFEM_SOLVER_CHOLESKY)
        status = dgfem_cholesky_create(system->matrix, &desc, &system->cholesky);
    else
        system->pcg_work =
            (dgfem_real *)dgfem_mvci_allocate(hooks, dgfem_pcg_work_size(system->matrix), sizeof(dgfem_real));
    if (status) return dgfem_mvci_fail(hooks, status, "the solver of %d nodes", body->node_count);
    system->diagonal = (size_t *)dgfem_mvci_allocate(hooks, (size_t)body->node_count, sizeof(size_t));
    if (!system->diagonal || (!system->cholesky && !system->pcg_work) || !dgfem_mvci_list_blocks(body, system))
        return dgfem_mvci_fail_memory(hooks);
    return DGFEM_OK;
}

/* The matrix and its solver, where they are not there yet: cuts leave them to the next step or solve, so that several
   in a row make them once. On failure nothing has changed. */
static dgfem_status dgfem_mvci_prepare_solver(dgfem_mvc *body, int is_cut) {
    if (body->system->matrix) return DGFEM_OK;
    dgfem_status status = dgfem_mvci_create_solver(body, body->system, is_cut);
    if (status) dgfem_mvci_free_solver(&body->hooks, body->system);
    return status;
}

/* ---- topology: all that is made anew when the mesh changes ---- */

static void dgfem_mvci_system_destroy(const dgfem_hooks *hooks, dgfem_mvc_system *system) {
    if (!system) return;
    dgfem_mvci_free(hooks, system->node_start);
    dgfem_mvci_free(hooks, system->nodes);
    dgfem_mvci_free(hooks, system->share);
    dgfem_mvci_free(hooks, system->mean);
    dgfem_mvci_free(hooks, system->pair_start);
    dgfem_mvci_free(hooks, system->stiffness);
    dgfem_mvci_free_solver(hooks, system);
    dgfem_mvci_free(hooks, system->held);
    dgfem_mvci_free(hooks, system->next);
    dgfem_mvci_free(hooks, system->work);
    dgfem_mvci_free(hooks, system->local);
    dgfem_mvci_free(hooks, system->use_start);
    dgfem_mvci_free(hooks, system->uses);
    dgfem_mvci_free(hooks, system);
}

/* Everything by node, element and pair, but not the mesh itself. */
static void dgfem_mvci_free_topology(dgfem_mvc *body) {
    const dgfem_hooks *hooks = &body->hooks;
    dgfem_mvci_free(hooks, body->mass);
    dgfem_mvci_free(hooks, body->area);
    dgfem_mvci_free(hooks, body->modulus);
    dgfem_mvci_free(hooks, body->material);
    dgfem_mvci_free(hooks, body->tag);
    dgfem_mvci_free(hooks, body->volume);
    dgfem_mvci_free(hooks, body->centre);
    dgfem_mvci_free(hooks, body->rotation);
    dgfem_mvci_system_destroy(hooks, body->system);
}

static int dgfem_mvci_allocate_topology(dgfem_mvc *body) {
    const dgfem_hooks *hooks = &body->hooks;
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    dgfem_mvc_system *system = (dgfem_mvc_system *)dgfem_mvci_allocate(hooks, 1, sizeof *system);
    body->system = system;
    body->mass = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->area = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->modulus = (dgfem_real *)dgfem_mvci_allocate(hooks, nodes, sizeof(dgfem_real));
    body->material = (dgfem_material *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_material));
    body->tag = (int *)dgfem_mvci_allocate(hooks, elements, sizeof(int));
    body->volume = (dgfem_real *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_real));
    body->centre = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_vec3));
    body->rotation = (dgfem_mat3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_mat3));
    if (!system || !body->mass || !body->area || !body->modulus || !body->material || !body->tag || !body->volume ||
        !body->centre || !body->rotation)
        return 0;
    system->held = (char *)dgfem_mvci_allocate(hooks, nodes, 1);
    system->next = (dgfem_mat3 *)dgfem_mvci_allocate(hooks, elements, sizeof(dgfem_mat3));
    system->work = (dgfem_vec3 *)dgfem_mvci_allocate(hooks, DGFEM_MVCI_VECTORS * nodes, sizeof(dgfem_vec3));
    return system->held && system->next && system->work;
}

/* Points the body at the state that the mesh holds. */
static void dgfem_mvci_adopt_mesh(dgfem_mvc *body, dgfem_mvci_mesh *mesh) {
    body->mesh = mesh;
    body->node_count = mesh->node_count;
    body->face_count = mesh->face_count;
    body->element_count = mesh->element_count;
    body->rest = mesh->rest;
    body->position = mesh->position;
    body->velocity = mesh->velocity;
}

/* Makes everything that follows from body->mesh, but for the matrix and its solver; body->material is filled in from
   desc.materials or from what the elements were in `before`. On failure the caller frees the topology. */
static dgfem_status dgfem_mvci_build_topology(dgfem_mvc *body, const dgfem_mesh *source, const dgfem_mvc *before) {
    size_t points;
    int corners;
    if (!dgfem_mvci_allocate_topology(body)) return dgfem_mvci_fail_memory(&body->hooks);
    for (int e = 0; e < body->element_count; e++) {
        int from = body->mesh->elements[e].from;
        body->material[e] = before                 ? before->material[from]
                            : body->desc.materials ? body->desc.materials[from]
                                                   : body->desc.material;
        body->tag[e] = before ? before->tag[from] : source->elements[from].tag;
        body->rotation[e] = before ? before->rotation[from] : dgfem_mvci_identity();
    }
    if (!dgfem_mvci_lay_out(body, body->system, &points, &corners)) return dgfem_mvci_fail_memory(&body->hooks);
    dgfem_status status = dgfem_mvci_integrate(body, body->system, before, points, corners);
    if (status) return status;
    dgfem_mvci_measure_nodes(body, body->system);
    if (before) body->system->factor_flops = before->system->factor_flops;
    return DGFEM_OK;
}

/* ==== create.c ==================================================================================================== */

/* A body's beginning and end. */

DGFEM_API dgfem_mvc_desc dgfem_default_mvc_desc(void) {
    dgfem_mvc_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.material.young = DGFEM_R(1e6);
    desc.material.poisson = DGFEM_R(0.3);
    desc.material.density = 1000;
    desc.quadrature = DGFEM_MVC_TET4;
    desc.gravity = dgfem_mvci_vec3(0, 0, DGFEM_R(-9.81));
    desc.warp = 1;
    desc.solver = DGFEM_SOLVER_CHOLESKY;
    desc.solver_tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-6);
    desc.solver_iterations = 1000;
    return desc;
}

/* A finite number, at least 0 (positive: above 0). */
static dgfem_status dgfem_mvci_check_scalar(const dgfem_hooks *hooks, dgfem_real x, int positive, const char *what) {
    if (!dgfem_mvci_is_finite(x)) return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
    if (positive ? x > 0 : x >= 0) return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%s %g, expected %s 0", what, (double)x, positive ? ">" : ">=");
}

static dgfem_status dgfem_mvci_check_vector(const dgfem_hooks *hooks, dgfem_vec3 v, const char *what) {
    if (dgfem_mvci_is_finite3(v)) return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "%s (%g, %g, %g)", what, (double)v.x, (double)v.y,
                           (double)v.z);
}

static dgfem_status dgfem_mvci_check_material(const dgfem_hooks *hooks, const dgfem_material *m, int element) {
    if (m->young > 0 && dgfem_mvci_is_finite(m->young) && m->density > 0 && dgfem_mvci_is_finite(m->density) &&
        m->poisson > -1 && m->poisson < DGFEM_R(0.5))
        return DGFEM_OK;
    return dgfem_mvci_fail(hooks, DGFEM_ERROR_MATERIAL, "element %d: young %g, poisson %g, density %g", element,
                           (double)m->young, (double)m->poisson, (double)m->density);
}

static dgfem_status dgfem_mvci_check_desc(const dgfem_mvc_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    if (!desc->mesh) return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "no mesh");
    if (desc->mesh->element_count < 1) return dgfem_mvci_fail(hooks, DGFEM_ERROR_EMPTY, "the mesh has no element");
    if ((int)desc->quadrature < 0 || desc->quadrature > DGFEM_MVC_PAPER_RAW)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown quadrature %d", (int)desc->quadrature);
    if (desc->solver != DGFEM_SOLVER_CHOLESKY && desc->solver != DGFEM_SOLVER_PCG)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT,
                               "solver %d: only DGFEM_SOLVER_CHOLESKY (%d) and DGFEM_SOLVER_PCG (%d) serve here",
                               (int)desc->solver, (int)DGFEM_SOLVER_CHOLESKY, (int)DGFEM_SOLVER_PCG);
    if (desc->solver_iterations < 1)
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "%d solver_iterations", desc->solver_iterations);
    dgfem_status status = dgfem_mvci_check_scalar(hooks, desc->stabilisation, 0, "stabilisation");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping_mass, 0, "damping_mass");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping_stiffness, 0, "damping_stiffness");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->solver_tolerance, 1, "solver_tolerance");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->gravity, "gravity");
    for (int e = 0; !status && e < desc->mesh->element_count; e++)
        status = dgfem_mvci_check_material(hooks, desc->materials ? &desc->materials[e] : &desc->material, e);
    return status;
}

static void dgfem_mvci_free_conditions(const dgfem_hooks *hooks, dgfem_mvc_condition *conditions, int count) {
    for (int c = 0; c < count; c++) {
        dgfem_mvci_free(hooks, conditions[c].items);
        dgfem_mvci_free(hooks, conditions[c].share);
    }
    dgfem_mvci_free(hooks, conditions);
}

DGFEM_API void dgfem_mvc_destroy(dgfem_mvc *body) {
    if (!body) return;
    dgfem_hooks hooks = body->hooks;
    dgfem_mvci_free_topology(body);
    dgfem_mvci_mesh_destroy(body->mesh);
    dgfem_mvci_free_conditions(&hooks, body->conditions, body->condition_count);
    dgfem_mvci_free(&hooks, body->shapes);
    dgfem_mvci_free(&hooks, body);
}

DGFEM_API dgfem_status dgfem_mvc_create(const dgfem_mvc_desc *desc, dgfem_mvc **out) {
    dgfem_mvci_mesh *mesh;
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!desc || desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_desc(desc);
    if (status) return status;
    dgfem_mvc *body = (dgfem_mvc *)dgfem_mvci_allocate(&desc->hooks, 1, sizeof *body);
    if (!body) return dgfem_mvci_fail_memory(&desc->hooks);
    body->desc = *desc;
    body->hooks = desc->hooks;
    status = dgfem_mvci_mesh_create(desc->mesh, &body->hooks, &mesh);
    if (!status) {
        dgfem_mvci_adopt_mesh(body, mesh);
        status = dgfem_mvci_build_topology(body, desc->mesh, NULL);
        if (!status) status = dgfem_mvci_prepare_solver(body, 0);
    }
    body->desc.mesh = NULL; /* the caller's arrays need not outlive this call */
    body->desc.materials = NULL;
    if (status) dgfem_mvc_destroy(body);
    else *out = body;
    return status;
}

/* ==== conditions.c ================================================================================================ */

/* What holds and loads a body: the list of conditions and contact shapes. */

static dgfem_status dgfem_mvci_check_items(const dgfem_mvc *body, const int *items, int count, int limit,
                                           const char *what) {
    if (count < 1 || !items)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition on %d %ss", count, what);
    for (int i = 0; i < count; i++)
        if (items[i] < 0 || items[i] >= limit)
            return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "%s %d of %d", what, items[i], limit);
    return DGFEM_OK;
}

static dgfem_status dgfem_mvci_check_loaded_faces(const dgfem_mvc *body, const int *faces, int count) {
    dgfem_status status = dgfem_mvci_check_items(body, faces, count, body->face_count, "face");
    for (int i = 0; !status && i < count; i++)
        if (body->mesh->faces[faces[i]].owner[1] != DGFEM_NONE)
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "face %d is not on the boundary", faces[i]);
    return status;
}

static dgfem_status dgfem_mvci_check_real(const dgfem_mvc *body, dgfem_real x, const char *what) {
    if (dgfem_mvci_is_finite(x)) return DGFEM_OK;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s %g", what, (double)x);
}

/* Appends a condition of checked items; the caller fills in the rest of *added. */
static dgfem_status dgfem_mvci_add_condition(dgfem_mvc *body, dgfem_mvc_condition_kind kind, const int *items,
                                             int count, int *id, dgfem_mvc_condition **added) {
    if (body->condition_count == body->condition_capacity) {
        int capacity = 2 * body->condition_capacity + 8;
        dgfem_mvc_condition *grown = (dgfem_mvc_condition *)dgfem_mvci_reallocate(&body->hooks, body->conditions,
                                                                                  (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_mvci_fail_memory(&body->hooks);
        body->conditions = grown;
        body->condition_capacity = capacity;
    }
    int shared = kind == DGFEM_MVC_CONDITION_FORCE || kind == DGFEM_MVC_CONDITION_PIN;
    int *copy = (int *)dgfem_mvci_duplicate(&body->hooks, items, (size_t)count, sizeof(int));
    dgfem_real *share =
        shared ? (dgfem_real *)dgfem_mvci_allocate(&body->hooks, (size_t)count, sizeof(dgfem_real)) : NULL;
    if (!copy || (shared && !share)) {
        dgfem_mvci_free(&body->hooks, copy);
        dgfem_mvci_free(&body->hooks, share);
        return dgfem_mvci_fail_memory(&body->hooks);
    }
    for (int i = 0; shared && i < count; i++) share[i] = 1;
    dgfem_mvc_condition *condition = &body->conditions[body->condition_count++];
    memset(condition, 0, sizeof *condition);
    condition->id = body->next_id++;
    condition->kind = kind;
    condition->items = copy;
    condition->share = share;
    condition->count = count;
    if (id) *id = condition->id;
    *added = condition;
    return DGFEM_OK;
}

static dgfem_mvc_condition *dgfem_mvci_find_condition(const dgfem_mvc *body, int id) {
    for (int c = 0; c < body->condition_count; c++)
        if (body->conditions[c].id == id) return &body->conditions[c];
    return NULL;
}

/* The condition of this id and, unless `any`, kind. */
static dgfem_status dgfem_mvci_get_condition(const dgfem_mvc *body, int id, dgfem_mvc_condition_kind kind, int any,
                                             dgfem_mvc_condition **out) {
    *out = dgfem_mvci_find_condition(body, id);
    if (!*out) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "no condition has the id %d", id);
    if (!any && (*out)->kind != kind)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is of another kind", id);
    return DGFEM_OK;
}

/* ---- what holds ---- */

static dgfem_status dgfem_mvci_fix(dgfem_mvc *body, const int *nodes, int count, int axes, int *id,
                                   dgfem_mvc_condition **condition) {
    dgfem_status status = dgfem_mvci_check_items(body, nodes, count, body->node_count, "node");
    if (!status && (axes < 1 || axes > DGFEM_MVC_XYZ))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "axes %d, expected 1..7", axes);
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_FIX, nodes, count, id, condition);
    if (!status) (*condition)->axes = axes;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_fix_nodes(dgfem_mvc *body, const int *nodes, int count, int axes,
                                           dgfem_vec3 displacement, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_vector(&body->hooks, displacement, "displacement");
    if (!status) status = dgfem_mvci_fix(body, nodes, count, axes, id, &condition);
    if (!status) condition->vector = displacement;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_fix_nodes_fn(dgfem_mvc *body, const int *nodes, int count, int axes,
                                              dgfem_displacement_fn fn, void *user, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!fn) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "no function");
    dgfem_status status = dgfem_mvci_fix(body, nodes, count, axes, id, &condition);
    if (status) return status;
    condition->fn = fn;
    condition->fn_user = user;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_move_fixture(dgfem_mvc *body, int id, dgfem_mat3 linear, dgfem_vec3 translation) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FIX, 0, &condition);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, translation, "translation");
    for (int i = 0; !status && i < 9; i++) status = dgfem_mvci_check_real(body, linear.m[i / 3][i % 3], "linear");
    if (status) return status;
    condition->linear = linear;
    condition->vector = translation;
    condition->fn = NULL;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_pin(dgfem_mvc *body, int node, dgfem_real stiffness, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_items(body, &node, 1, body->node_count, "node");
    if (!status) status = dgfem_mvci_check_scalar(&body->hooks, stiffness, 0, "stiffness");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_PIN, &node, 1, id, &condition);
    if (status) return status;
    condition->scalar = stiffness;
    condition->vector = body->position[node];
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_drag(dgfem_mvc *body, int id, dgfem_vec3 place) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_PIN, 0, &condition);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, place, "place");
    if (!status) condition->vector = place;
    return status;
}

/* ---- what loads ---- */

DGFEM_API dgfem_status dgfem_mvc_set_traction(dgfem_mvc *body, const int *faces, int count, dgfem_vec3 traction,
                                              int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_loaded_faces(body, faces, count);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, traction, "traction");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_TRACTION, faces, count, id, &condition);
    if (!status) condition->vector = traction;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_set_pressure(dgfem_mvc *body, const int *faces, int count, dgfem_real pressure,
                                              int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_loaded_faces(body, faces, count);
    if (!status) status = dgfem_mvci_check_real(body, pressure, "pressure");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_PRESSURE, faces, count, id, &condition);
    if (!status) condition->scalar = pressure;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_add_force(dgfem_mvc *body, const int *nodes, int count, dgfem_vec3 force, int *id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_items(body, nodes, count, body->node_count, "node");
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, force, "force");
    if (!status) status = dgfem_mvci_add_condition(body, DGFEM_MVC_CONDITION_FORCE, nodes, count, id, &condition);
    if (!status) condition->vector = force;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_change_load(dgfem_mvc *body, int id, dgfem_vec3 vector, dgfem_real scalar) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FORCE, 1, &condition);
    if (!status && (condition->kind == DGFEM_MVC_CONDITION_FIX || condition->kind == DGFEM_MVC_CONDITION_PIN))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "condition %d is not a load", id);
    if (!status) status = dgfem_mvci_check_vector(&body->hooks, vector, "load");
    if (!status) status = dgfem_mvci_check_real(body, scalar, "load");
    if (status) return status;
    condition->vector = vector;
    condition->scalar = scalar;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_set_gravity(dgfem_mvc *body, dgfem_vec3 gravity) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_vector(&body->hooks, gravity, "gravity");
    if (!status) body->desc.gravity = gravity;
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_remove_condition(dgfem_mvc *body, int id) {
    dgfem_mvc_condition *condition;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_get_condition(body, id, DGFEM_MVC_CONDITION_FIX, 1, &condition);
    if (status) return status;
    dgfem_mvci_free(&body->hooks, condition->items);
    dgfem_mvci_free(&body->hooks, condition->share);
    body->condition_count--;
    memmove(condition, condition + 1,
            (size_t)(body->conditions + body->condition_count - condition) * sizeof *condition);
    return DGFEM_OK;
}

/* ---- contact shapes ---- */

static dgfem_status dgfem_mvci_check_obstacle(const dgfem_mvc *body, dgfem_shape_kind kind,
                                              const dgfem_shape_desc *desc) {
    const dgfem_hooks *hooks = &body->hooks;
    if (!desc || desc->cookie != dgfem_default_shape_desc().cookie) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_scalar(hooks, desc->stiffness, 0, "stiffness");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->damping, 0, "damping");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->friction, 0, "friction");
    if (!status) status = dgfem_mvci_check_scalar(hooks, desc->slip_speed, 1, "slip_speed");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->velocity, "velocity");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->centre, "centre");
    if (!status) status = dgfem_mvci_check_vector(hooks, desc->plane.normal, "normal");
    if (!status) status = dgfem_mvci_check_real(body, desc->plane.offset, "offset");
    if (!status) status = dgfem_mvci_check_real(body, desc->radius, "radius");
    if (!status && kind == DGFEM_SHAPE_PLANE && !(dgfem_mvci_norm(desc->plane.normal) > 0))
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "the plane's normal is zero");
    if (!status && kind == DGFEM_SHAPE_PLANE)
        status = dgfem_mvci_check_real(body, dgfem_mvci_norm(desc->plane.normal), "length of the plane's normal");
    if (!status && kind == DGFEM_SHAPE_SPHERE && desc->radius == 0)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "the sphere's radius is 0");
    return status;
}

static dgfem_status dgfem_mvci_add_shape(dgfem_mvc *body, dgfem_shape_kind kind, const dgfem_shape_desc *desc,
                                         int *id) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_obstacle(body, kind, desc);
    if (status) return status;
    if (body->shape_count == body->shape_capacity) {
        int capacity = 2 * body->shape_capacity + 4;
        dgfem_shape *grown =
            (dgfem_shape *)dgfem_mvci_reallocate(&body->hooks, body->shapes, (size_t)capacity, sizeof *grown);
        if (!grown) return dgfem_mvci_fail_memory(&body->hooks);
        body->shapes = grown;
        body->shape_capacity = capacity;
    }
    dgfem_shape *shape = &body->shapes[body->shape_count++];
    memset(shape, 0, sizeof *shape);
    shape->id = body->next_id++;
    shape->kind = kind;
    shape->desc = *desc;
    if (id) *id = shape->id;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_add_plane(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id) {
    return dgfem_mvci_add_shape(body, DGFEM_SHAPE_PLANE, desc, id);
}

DGFEM_API dgfem_status dgfem_mvc_add_sphere(dgfem_mvc *body, const dgfem_shape_desc *desc, int *id) {
    return dgfem_mvci_add_shape(body, DGFEM_SHAPE_SPHERE, desc, id);
}

DGFEM_API dgfem_status dgfem_mvc_move_shape(dgfem_mvc *body, int id, const dgfem_shape_desc *desc) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    for (int s = 0; s < body->shape_count; s++) {
        if (body->shapes[s].id != id) continue;
        dgfem_status status = dgfem_mvci_check_obstacle(body, body->shapes[s].kind, desc);
        if (!status) body->shapes[s].desc = *desc;
        return status;
    }
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "no shape has the id %d", id);
}

/* ==== warp.c ====================================================================================================== */

/* Stiffness warping: rotations of elements, elastic forces and stiffness in rotated frames.

   An element's rotation R, from rest X to now x, is the one that minimizes sum mu_i |R (X_i - X_c) - (x_i - x_c)|^2
   (Horn 1987): the unit quaternion of the largest eigenvalue of a symmetric 4 x 4 matrix. With it
     f = -R K (R^T (x - x_c) - (X - X_c)),    K_w = R K R^T */

/* A rotation is not determined where the two largest eigenvalues are closer than this times the size of the matrix,
   or of its value at rest. */
#define DGFEM_MVCI_NO_ROTATION (DGFEM_REAL_IS_FLOAT ? 1e-5 : 1e-8)

/* Eigenvalues of a symmetric 4 x 4 matrix on its diagonal, eigenvectors in the columns of v, by Jacobi's method. */
static void dgfem_mvci_jacobi4(double a[4][4], double v[4][4]) {
    for (int i = 0; i < 16; i++) v[i / 4][i % 4] = i % 5 == 0;
    for (int sweep = 0; sweep < 30; sweep++) {
        double off = 0, all = 0;
        for (int i = 0; i < 16; i++) {
            double square = a[i / 4][i % 4] * a[i / 4][i % 4];
            all += square;
            if (i % 5) off += square;
        }
        if (!(off > 1e-34 * all)) return;
        for (int p = 0; p < 3; p++)
            for (int q = p + 1; q < 4; q++) {
                if (a[p][q] == 0) continue;
                double half = (a[q][q] - a[p][p]) / (2 * a[p][q]);
                double t = (half < 0 ? -1 : 1) / (fabs(half) + sqrt(half * half + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int k = 0; k < 4; k++) {
                    double x = a[k][p], y = a[k][q];
                    a[k][p] = c * x - s * y, a[k][q] = s * x + c * y;
                    x = v[k][p], y = v[k][q];
                    v[k][p] = c * x - s * y, v[k][q] = s * x + c * y;
                }
                for (int k = 0; k < 4; k++) {
                    double x = a[p][k], y = a[q][k];
                    a[p][k] = c * x - s * y, a[q][k] = s * x + c * y;
                }
            }
    }
}

static dgfem_mat3 dgfem_mvci_quaternion_rotation(double w, double x, double y, double z) {
    dgfem_mat3 r;
    r.m[0][0] = (dgfem_real)(w * w + x * x - y * y - z * z);
    r.m[0][1] = (dgfem_real)(2 * (x * y - w * z));
    r.m[0][2] = (dgfem_real)(2 * (x * z + w * y));
    r.m[1][0] = (dgfem_real)(2 * (x * y + w * z));
    r.m[1][1] = (dgfem_real)(w * w - x * x + y * y - z * z);
    r.m[1][2] = (dgfem_real)(2 * (y * z - w * x));
    r.m[2][0] = (dgfem_real)(2 * (x * z - w * y));
    r.m[2][1] = (dgfem_real)(2 * (y * z + w * x));
    r.m[2][2] = (dgfem_real)(w * w - x * x - y * y + z * z);
    return r;
}

/* x = a^-1 b for a symmetric matrix. 0 where not all its pivots are above `least`. */
static int dgfem_mvci_solve3(const double a[3][3], const double b[3], double least, double x[3]) {
    double d0 = a[0][0], l1 = a[1][0] / d0, l2 = a[2][0] / d0, d1 = a[1][1] - l1 * a[1][0];
    double c = a[2][1] - l2 * a[1][0], l3 = c / d1, d2 = a[2][2] - l2 * a[2][0] - l3 * c;
    if (!(d0 > least && d1 > least && d2 > least)) return 0;
    double y1 = b[1] - l1 * b[0], y2 = b[2] - l2 * b[0] - l3 * y1;
    x[2] = y2 / d2;
    x[1] = y1 / d1 - l3 * x[2];
    x[0] = b[0] / d0 - l1 * x[1] - l2 * x[2];
    return 1;
}

/* c = a b. */
static void dgfem_mvci_product3(const double a[3][3], const double b[3][3], double c[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* A rotation close to q: (3 q - q q^T q) / 2, for one that is so but for round-off. */
static void dgfem_mvci_straighten(double q[3][3]) {
    double square[3][3], cube[3][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) square[i][j] = q[i][0] * q[j][0] + q[i][1] * q[j][1] + q[i][2] * q[j][2];
    dgfem_mvci_product3((const double(*)[3])square, (const double(*)[3])q, cube);
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = (3 * q[i / 3][i % 3] - cube[i / 3][i % 3]) / 2;
}

/* Newton's method for the rotation q that makes tr(q s) greatest, from `last`. With m = q s, a small turn w changes the
   trace by w . axis(m) - w . (tr m - m) w / 2. Of the places where m is symmetric, only the greatest has tr m - m
   positive definite. 0 where that is not reached, or nearly not. */
static int dgfem_mvci_follow(const double s[3][3], double size, const dgfem_mat3 *last, dgfem_mat3 *out) {
    double q[3][3], m[3][3], b[3], w[3], turn[3][3], a[3][3], next[3][3], square = 1;
    for (int i = 0; i < 9; i++) q[i / 3][i % 3] = (double)last->m[i / 3][i % 3];
    dgfem_mvci_straighten(q);
    for (int step = 0; step < 8; step++) {
        dgfem_mvci_product3((const double(*)[3])q, s, m);
        double trace = m[0][0] + m[1][1] + m[2][2];
        for (int i = 0; i < 9; i++) a[i / 3][i % 3] = (i % 4 ? 0 : trace) - (m[i / 3][i % 3] + m[i % 3][i / 3]) / 2;
        b[0] = m[1][2] - m[2][1], b[1] = m[2][0] - m[0][2], b[2] = m[0][1] - m[1][0];
        if (!dgfem_mvci_solve3((const double(*)[3])a, b, 1e-3 * size, w)) return 0;
        if (square < 1e-18) break; /* the turn before was this short: what is left is its square */
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
        if (!(square < 4)) return 0;
        double h[3], scale = 2 / (1 + square / 4);
        for (int k = 0; k < 3; k++) h[k] = w[k] / 2;
        for (int i = 0; i < 9; i++)
            turn[i / 3][i % 3] = scale * h[i / 3] * h[i % 3] + (i % 4 ? 0 : 1 - scale * (square / 4));
        turn[0][1] -= scale * h[2], turn[1][0] += scale * h[2];
        turn[0][2] += scale * h[1], turn[2][0] -= scale * h[1];
        turn[1][2] -= scale * h[0], turn[2][1] += scale * h[0];
        dgfem_mvci_product3((const double(*)[3])turn, (const double(*)[3])q, next);
        memcpy(q, next, sizeof q);
    }
    if (!(square < 1e-18)) return 0;
    for (int i = 0; i < 9; i++) out->m[i / 3][i % 3] = (dgfem_real)q[i / 3][i % 3];
    return 1;
}

/* Horn's fit to s = sum of weights times rest (row) times position (column), both about their centres, at rest of trace
   `inertia`; `last` where it is not determined: all in one place, on a line, or inverted like a point reflection. */
static dgfem_mat3 dgfem_mvci_horn(double s[3][3], double inertia, const dgfem_mat3 *last) {
    double a[4][4], v[4][4], size = inertia * inertia;
    int best = 0, second = 1;
    for (int i = 0; i < 9; i++) size += s[i / 3][i % 3] * s[i / 3][i % 3];
    dgfem_mat3 near;
    if (dgfem_mvci_follow((const double(*)[3])s, sqrt(size), last, &near)) return near;
    a[0][0] = s[0][0] + s[1][1] + s[2][2];
    a[0][1] = a[1][0] = s[1][2] - s[2][1];
    a[0][2] = a[2][0] = s[2][0] - s[0][2];
    a[0][3] = a[3][0] = s[0][1] - s[1][0];
    a[1][1] = s[0][0] - s[1][1] - s[2][2];
    a[2][2] = s[1][1] - s[0][0] - s[2][2];
    a[3][3] = s[2][2] - s[0][0] - s[1][1];
    a[1][2] = a[2][1] = s[0][1] + s[1][0];
    a[1][3] = a[3][1] = s[2][0] + s[0][2];
    a[2][3] = a[3][2] = s[1][2] + s[2][1];
    dgfem_mvci_jacobi4(a, v);
    for (int i = 1; i < 4; i++) {
        if (a[i][i] > a[best][best]) second = best, best = i;
        else if (a[i][i] > a[second][second] || second == best) second = i;
    }
    if (!(a[best][best] - a[second][second] > DGFEM_MVCI_NO_ROTATION * sqrt(size))) return *last;
    return dgfem_mvci_quaternion_rotation(v[0][best], v[1][best], v[2][best], v[3][best]);
}

/* The weighted mean of nodal values over an element: of rest places its centroid. */
static dgfem_vec3 dgfem_mvci_element_mean(const dgfem_mvc *body, int e, const dgfem_vec3 *x) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 first = x[system->nodes[system->node_start[e]]], sum = dgfem_mvci_vec3(0, 0, 0);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
        sum = dgfem_mvci_axpy(sum, system->share[i], dgfem_mvci_sub(x[system->nodes[i]], first));
    return dgfem_mvci_add(first, sum);
}

static dgfem_mat3 dgfem_mvci_element_rotation(const dgfem_mvc *body, int e, const dgfem_vec3 *x) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, x);
    double s[3][3], inertia = 0;
    memset(s, 0, sizeof s);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
        dgfem_vec3 from = dgfem_mvci_sub(body->rest[system->nodes[i]], body->centre[e]);
        dgfem_vec3 to = dgfem_mvci_sub(x[system->nodes[i]], centre);
        double a[3], b[3];
        a[0] = (double)from.x, a[1] = (double)from.y, a[2] = (double)from.z;
        b[0] = (double)to.x, b[1] = (double)to.y, b[2] = (double)to.z;
        for (int k = 0; k < 9; k++) s[k / 3][k % 3] += (double)system->share[i] * a[k / 3] * b[k % 3];
        inertia += (double)system->share[i] * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    }
    return dgfem_mvci_horn(s, inertia, &body->rotation[e]);
}

/* A loop over all elements, nodes or blocks. */
typedef struct dgfem_mvci_pass {
    const dgfem_mvc *body;
    const dgfem_mat3 *rotation; /* [element_count] */
    dgfem_mat3 *rotation_out;
    dgfem_vec3 *force; /* [node_count] */
    dgfem_real factor;
} dgfem_mvci_pass;

static void dgfem_mvci_rotate_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    for (int e = first; e < last; e++)
        pass->rotation_out[e] = dgfem_mvci_element_rotation(pass->body, e, pass->body->position);
}

/* Rotations of all elements at the current positions. */
static void dgfem_mvci_rotations(const dgfem_mvc *body, dgfem_mat3 *out) {
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation_out = out;
    if (body->desc.warp) dgfem_mvci_run(&body->hooks, body->element_count, 32, dgfem_mvci_rotate_range, &pass);
    for (int e = 0; !body->desc.warp && e < body->element_count; e++) out[e] = dgfem_mvci_identity();
}

/* ---- forces ---- */

/* y = R^T (x - x_c) - (X - X_c) at the k-th node of an element. */
static dgfem_vec3 dgfem_mvci_local_displacement(const dgfem_mvc *body, int e, int k, const dgfem_mat3 *rotation,
                                                dgfem_vec3 centre) {
    int node = body->system->nodes[body->system->node_start[e] + k];
    dgfem_vec3 now = dgfem_mvci_multiply_transposed(rotation, dgfem_mvci_sub(body->position[node], centre));
    return dgfem_mvci_sub(now, dgfem_mvci_sub(body->rest[node], body->centre[e]));
}

static dgfem_vec3 dgfem_mvci_block_multiply(const dgfem_real *m, dgfem_vec3 v) {
    return dgfem_mvci_vec3(m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z,
                           m[6] * v.x + m[7] * v.y + m[8] * v.z);
}

static dgfem_vec3 dgfem_mvci_block_multiply_transposed(const dgfem_real *m, dgfem_vec3 v) {
    return dgfem_mvci_vec3(m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z,
                           m[2] * v.x + m[5] * v.y + m[8] * v.z);
}

/* R K y of an element into its part of system->local; returns its elastic energy. */
static dgfem_real dgfem_mvci_element_push(const dgfem_mvc *body, int e, const dgfem_mat3 *rotation) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_real *block = system->stiffness + 9 * system->pair_start[e];
    int start = system->node_start[e], count = system->node_start[e + 1] - start;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, body->position);
    dgfem_vec3 *y = system->local + start, *force = y + system->node_start[body->element_count];
    dgfem_real energy = 0;
    for (int a = 0; a < count; a++) {
        y[a] = dgfem_mvci_local_displacement(body, e, a, rotation, centre);
        force[a] = dgfem_mvci_vec3(0, 0, 0);
        for (int b = 0; b < a; b++, block += 9) {
            force[a] = dgfem_mvci_add(force[a], dgfem_mvci_block_multiply(block, y[b]));
            force[b] = dgfem_mvci_add(force[b], dgfem_mvci_block_multiply_transposed(block, y[a]));
        }
        force[a] = dgfem_mvci_add(force[a], dgfem_mvci_block_multiply(block, y[a]));
        block += 9;
    }
    for (int a = 0; a < count; a++) {
        energy += dgfem_mvci_dot(y[a], force[a]) / 2;
        force[a] = dgfem_mvci_multiply(rotation, force[a]);
    }
    return energy;
}

static void dgfem_mvci_push_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    for (int e = first; e < last; e++) (void)dgfem_mvci_element_push(pass->body, e, &pass->rotation[e]);
}

/* Sums in the order of elements, whatever the threads. */
static void dgfem_mvci_gather_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    const dgfem_mvc_system *system = pass->body->system;
    const dgfem_vec3 *force = system->local + system->node_start[pass->body->element_count];
    for (int i = first; i < last; i++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0);
        for (int k = system->use_start[i]; k < system->use_start[i + 1]; k++)
            sum = dgfem_mvci_add(sum, force[system->uses[k]]);
        pass->force[i] = sum;
    }
}

/* Elastic force on each node, as R K y. */
static void dgfem_mvci_forces(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_vec3 *out) {
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation = rotation, pass.force = out;
    dgfem_mvci_run(&body->hooks, body->element_count, 16, dgfem_mvci_push_range, &pass);
    dgfem_mvci_run(&body->hooks, body->node_count, 64, dgfem_mvci_gather_range, &pass);
}

/* ---- stiffness ---- */

/* sum += factor * R K R^T, transposed where `turned`. */
static void dgfem_mvci_add_rotated(dgfem_real *sum, dgfem_real factor, const dgfem_mat3 *rotation,
                                   const dgfem_real *block, int turned) {
    dgfem_mat3 m, back = dgfem_mvci_transposed(rotation);
    memcpy(&m, block, sizeof m);
    m = dgfem_mvci_multiply3(&m, &back);
    m = dgfem_mvci_multiply3(rotation, &m);
    if (turned) m = dgfem_mvci_transposed(&m);
    for (int i = 0; i < 9; i++) sum[i] += factor * m.m[i / 3][i % 3];
}

/* Element by element: reads the stiffness in the order in which it lies in memory. */
static void dgfem_mvci_scatter_stiffness(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_real factor) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_real *block = system->stiffness;
    const int *place = system->places;
    dgfem_matrix_clear(system->matrix);
    for (int e = 0; e < body->element_count; e++) {
        const int *nodes = system->nodes + system->node_start[e];
        int count = system->node_start[e + 1] - system->node_start[e];
        for (int a = 0; a < count; a++)
            for (int b = 0; b <= a; b++, block += 9, place++)
                dgfem_mvci_add_rotated(system->matrix->values + 9 * (size_t)*place, factor, &rotation[e], block,
                                       nodes[a] < nodes[b]);
    }
}

/* Block by block, each summed in the order of elements: threads do not meet, and bits are those of the above. */
static void dgfem_mvci_assemble_range(void *context, int first, int last) {
    const dgfem_mvci_pass *pass = (const dgfem_mvci_pass *)context;
    const dgfem_mvc_system *system = pass->body->system;
    for (int k = first; k < last; k++) {
        dgfem_real sum[9];
        memset(sum, 0, sizeof sum);
        for (int p = system->part_start[k]; p < system->part_start[k + 1]; p++) {
            const dgfem_mvci_block_part *part = &system->parts[p];
            dgfem_mvci_add_rotated(sum, pass->factor, &pass->rotation[part->element],
                                   system->stiffness + 9 * (size_t)part->pair, part->turned);
        }
        memcpy(system->matrix->values + 9 * (size_t)k, sum, sizeof sum);
    }
}

/* The matrix becomes factor * sum R K R^T. */
static void dgfem_mvci_assemble_stiffness(const dgfem_mvc *body, const dgfem_mat3 *rotation, dgfem_real factor) {
    const dgfem_matrix *matrix = body->system->matrix;
    dgfem_mvci_pass pass;
    memset(&pass, 0, sizeof pass);
    pass.body = body, pass.rotation = rotation, pass.factor = factor;
    if (!body->hooks.parallel_for) dgfem_mvci_scatter_stiffness(body, rotation, factor);
    else dgfem_mvci_run(&body->hooks, matrix->row_start[matrix->block_count], 64, dgfem_mvci_assemble_range, &pass);
}

/* ==== load.c ====================================================================================================== */

/* External forces, contact, held nodes. */

static int dgfem_mvci_is_face_load(const dgfem_mvc_condition *condition) {
    return condition->kind == DGFEM_MVC_CONDITION_TRACTION || condition->kind == DGFEM_MVC_CONDITION_PRESSURE;
}

/* A displacement that is linear on triangles takes a third of each triangle's load at each of its nodes: exactly for
   uniform tractions, and for pressure on the current, flat triangles. */
static void dgfem_mvci_add_face_load(const dgfem_mvc *body, const dgfem_mvc_condition *condition, dgfem_real factor,
                                     dgfem_vec3 *out) {
    for (int k = 0; k < condition->count; k++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, condition->items[k], &count);
        for (int t = 0; t < count; t++, at += 3) {
            dgfem_vec3 load;
            if (condition->kind == DGFEM_MVC_CONDITION_PRESSURE)
                load = dgfem_mvci_scale(-condition->scalar / 6, dgfem_mvci_loop_area(body->position, at, 3));
            else
                load =
                    dgfem_mvci_scale(dgfem_mvci_norm(dgfem_mvci_loop_area(body->rest, at, 3)) / 6, condition->vector);
            for (int i = 0; i < 3; i++) out[at[i]] = dgfem_mvci_axpy(out[at[i]], factor, load);
        }
    }
}

/* out += factor * (gravity and loads); pins are apart. */
static void dgfem_mvci_add_external(const dgfem_mvc *body, dgfem_real factor, dgfem_vec3 *out) {
    for (int i = 0; i < body->node_count; i++)
        out[i] = dgfem_mvci_axpy(out[i], factor * body->mass[i], body->desc.gravity);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *condition = &body->conditions[c];
        if (dgfem_mvci_is_face_load(condition)) dgfem_mvci_add_face_load(body, condition, factor, out);
        if (condition->kind != DGFEM_MVC_CONDITION_FORCE) continue;
        for (int i = 0; i < condition->count; i++) {
            dgfem_vec3 *to = &out[condition->items[i]];
            *to = dgfem_mvci_axpy(*to, factor * condition->share[i], condition->vector);
        }
    }
}

/* Adds the springs of all pins, times `stiffness`, to the matrix, and their force, times `force`, to rhs. */
static void dgfem_mvci_assemble_pins(const dgfem_mvc *body, dgfem_real stiffness, dgfem_real force, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *pin = &body->conditions[c];
        for (int i = 0; pin->kind == DGFEM_MVC_CONDITION_PIN && i < pin->count; i++) {
            int node = pin->items[i];
            dgfem_real spring = pin->scalar * pin->share[i], *block = system->matrix->values + system->diagonal[node];
            for (int k = 0; k < 9; k += 4) block[k] += stiffness * spring;
            rhs[node] = dgfem_mvci_axpy(rhs[node], force * spring, dgfem_mvci_sub(pin->vector, body->position[node]));
        }
    }
}

/* ---- contact ---- */

typedef struct dgfem_mvci_contact {
    dgfem_vec3 normal;
    dgfem_real depth; /* at the beginning of the step */
} dgfem_mvci_contact;

/* Whether the node presses against the shape at the end of the step, moving on as it does: one that leaves is not held
   back, one that arrives (depth < 0) is stopped at the surface. Below the surface gravity counts with what it will add,
   and damping acts: without gravity a body at rest would hop by g h^2 forever. Above it must not count: a foot that
   something else wants to lift would be glued to the ground. */
static int dgfem_mvci_contact_is_active(const dgfem_shape *shape, dgfem_vec3 x, dgfem_vec3 v, dgfem_vec3 gravity,
                                        dgfem_real h, dgfem_mvci_contact *contact) {
    dgfem_vec3 relative = dgfem_mvci_sub(v, shape->desc.velocity);
    dgfem_real delay = h;
    contact->depth = -dgfem_shape_distance(shape, x, &contact->normal);
    if (contact->depth > 0) {
        relative = dgfem_mvci_axpy(relative, h, gravity);
        delay += shape->desc.damping;
    }
    return contact->depth - delay * dgfem_mvci_dot(contact->normal, relative) > 0;
}

/* Adds an active contact of stiffness k: block v+ = ... + g. Friction follows the normal force that the last step has
   left, k depth and its damping: a node that has just arrived feels it one step later, when what stopped it is known.
   */
static void dgfem_mvci_add_contact(const dgfem_shape *shape, const dgfem_mvci_contact *contact, dgfem_vec3 v,
                                   dgfem_real k, dgfem_real h, dgfem_real *block, dgfem_vec3 *g) {
    const dgfem_shape_desc *desc = &shape->desc;
    dgfem_vec3 n = contact->normal, relative = dgfem_mvci_sub(v, desc->velocity);
    dgfem_real speed = dgfem_mvci_dot(n, relative), normal = h * h * k, tangential = 0;
    if (contact->depth > 0) {
        dgfem_real force = k * (contact->depth - desc->damping * speed);
        dgfem_real slip = dgfem_mvci_norm(dgfem_mvci_axpy(relative, -speed, n));
        normal += h * desc->damping * k;
        if (force > 0) tangential = h * desc->friction * force / dgfem_mvci_max(slip, desc->slip_speed);
    }
    for (int i = 0; i < 9; i += 4) block[i] += tangential;
    dgfem_mvci_add_block(block, normal - tangential, n, n);
    speed = dgfem_mvci_dot(n, desc->velocity);
    *g = dgfem_mvci_axpy(*g, tangential, desc->velocity);
    *g = dgfem_mvci_axpy(*g, h * k * contact->depth + (normal - tangential) * speed, n);
}

/* Contact of all boundary nodes, each with its part of the surface: pressure = stiffness (E / radius) depth. Returns
   the number of nodes that touch. */
static int dgfem_mvci_assemble_contact(const dgfem_mvc *body, dgfem_real h, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    int count = 0;
    for (int i = 0; body->shape_count && i < body->node_count; i++) {
        int touching = 0;
        if (!(body->area[i] > 0)) continue;
        for (int s = 0; s < body->shape_count; s++) {
            const dgfem_shape *shape = &body->shapes[s];
            dgfem_mvci_contact contact;
            if (!dgfem_mvci_contact_is_active(shape, body->position[i], body->velocity[i], body->desc.gravity, h,
                                              &contact))
                continue;
            dgfem_mvci_add_contact(shape, &contact, body->velocity[i],
                                   shape->desc.stiffness * body->modulus[i] * body->area[i], h,
                                   system->matrix->values + system->diagonal[i], &rhs[i]);
            touching = 1;
        }
        count += touching;
    }
    return count;
}

/* ---- held nodes ---- */

/* Target displacements, times factor, and axes of all held nodes. */
static dgfem_status dgfem_mvci_collect_held(const dgfem_mvc *body, dgfem_real factor) {
    char *held = body->system->held;
    dgfem_vec3 *target = dgfem_mvci_vector(body, DGFEM_MVCI_TARGET);
    memset(held, 0, (size_t)body->node_count);
    for (int c = 0; c < body->condition_count; c++) {
        const dgfem_mvc_condition *condition = &body->conditions[c];
        for (int i = 0; condition->kind == DGFEM_MVC_CONDITION_FIX && i < condition->count; i++) {
            int node = condition->items[i];
            dgfem_vec3 u = dgfem_mvci_add(dgfem_mvci_multiply(&condition->linear, body->rest[node]), condition->vector);
            if (condition->fn) condition->fn(condition->fn_user, body->rest[node], &u);
            if (!dgfem_mvci_is_finite3(u))
                return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "displacement of node %d (condition %d)",
                                       node, condition->id);
            if (condition->axes & DGFEM_MVC_X) target[node].x = factor * u.x;
            if (condition->axes & DGFEM_MVC_Y) target[node].y = factor * u.y;
            if (condition->axes & DGFEM_MVC_Z) target[node].z = factor * u.z;
            held[node] = (char)(held[node] | condition->axes);
        }
    }
    return DGFEM_OK;
}

/* Writes to x, at held axes, what leads in time h from the current positions to the targets. */
static void dgfem_mvci_hold_vector(const dgfem_mvc *body, dgfem_real h, dgfem_vec3 *x) {
    const dgfem_vec3 *target = dgfem_mvci_vector(body, DGFEM_MVCI_TARGET);
    for (int i = 0; i < body->node_count; i++) {
        int axes = body->system->held[i];
        dgfem_vec3 way = dgfem_mvci_sub(dgfem_mvci_add(body->rest[i], target[i]), body->position[i]);
        if (axes & DGFEM_MVC_X) x[i].x = way.x / h;
        if (axes & DGFEM_MVC_Y) x[i].y = way.y / h;
        if (axes & DGFEM_MVC_Z) x[i].z = way.z / h;
    }
}

/* Moves the columns of held axes, whose unknowns stand in x, to the right-hand side, and makes their rows the identity
   times the size of the diagonal. */
static void dgfem_mvci_hold_matrix(const dgfem_mvc *body, const dgfem_vec3 *x, dgfem_vec3 *rhs) {
    const dgfem_mvc_system *system = body->system;
    const dgfem_matrix *matrix = system->matrix;
    const dgfem_real *known = (const dgfem_real *)(const void *)x;
    dgfem_real *b = dgfem_mvci_reals(rhs);
    for (int r = 0; r < matrix->block_count; r++)
        for (int k = matrix->row_start[r]; k < matrix->row_start[r + 1]; k++) {
            int c = matrix->column[k];
            dgfem_real *block = matrix->values + matrix->value_start[k];
            dgfem_real size = (block[0] + block[4] + block[8]) / 3;
            if (!system->held[r] && !system->held[c]) continue;
            for (int i = 0; i < 9; i++) {
                int row_held = system->held[r] >> (i / 3) & 1, column_held = system->held[c] >> (i % 3) & 1;
                if (column_held && !row_held) b[3 * r + i / 3] -= block[i] * known[3 * c + i % 3];
                if (r != c && row_held && !column_held) b[3 * c + i % 3] -= block[i] * known[3 * r + i / 3];
                if (!row_held && !column_held) continue;
                block[i] = r == c && i % 4 == 0 ? size : 0;
                if (r == c && i % 4 == 0) b[3 * r + i / 3] = size * known[3 * r + i / 3];
            }
        }
}

/* ==== solve.c ===================================================================================================== */

/* Moving a body: the time step and the static solve. */

static dgfem_mvc_info dgfem_mvci_empty_info(void) {
    dgfem_mvc_info info;
    memset(&info, 0, sizeof info);
    info.failed_node = DGFEM_NONE;
    return info;
}

/* Solves the system; x holds the start of an iteration. */
static dgfem_status dgfem_mvci_solve(dgfem_mvc *body, dgfem_vec3 *rhs, dgfem_vec3 *x, dgfem_mvc_info *info) {
    const dgfem_hooks *hooks = &body->hooks;
    double start = dgfem_mvci_clock(hooks);
    dgfem_status status;
    if (body->desc.solver == DGFEM_SOLVER_PCG) {
        dgfem_pcg_desc desc = dgfem_default_pcg_desc();
        dgfem_pcg_info pcg;
        memset(&pcg, 0, sizeof pcg);
        desc.tolerance = body->desc.solver_tolerance;
        desc.max_iterations = body->desc.solver_iterations;
        desc.work = body->system->pcg_work;
        desc.hooks = *hooks;
        desc.hooks.log = NULL;
        status = dgfem_pcg(body->system->matrix, &desc, dgfem_mvci_reals(rhs), dgfem_mvci_reals(x), &pcg);
        info->iterations += pcg.iterations;
        info->residual = pcg.residual;
        info->failed_node = pcg.failed_block;
        info->seconds_solve += dgfem_mvci_clock(hooks) - start;
    } else {
        dgfem_cholesky_info factor;
        memset(&factor, 0, sizeof factor);
        status = dgfem_cholesky_factor(body->system->cholesky, body->system->matrix, &factor);
        double middle = dgfem_mvci_clock(hooks);
        info->seconds_factor += middle - start;
        info->failed_node = factor.failed_block;
        body->system->factor_flops = factor.factor_flops;
        if (!status) status = dgfem_cholesky_solve(body->system->cholesky, dgfem_mvci_reals(rhs), dgfem_mvci_reals(x));
        info->seconds_solve += dgfem_mvci_clock(hooks) - middle;
    }
    if (status)
        return dgfem_mvci_fail(hooks, status, "linear system: node %d, residual %g after %d iterations",
                               info->failed_node, (double)info->residual, info->iterations);
    for (int i = 0; i < body->node_count; i++)
        if (!dgfem_mvci_is_finite3(x[i]))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "solution at node %d", i);
    return DGFEM_OK;
}

/* ---- time step ---- */

/* System of one step: (M + h D + h^2 K) v+ = M v + h (F - f), D = alpha M + beta K; contact added. */
static void dgfem_mvci_assemble_step(dgfem_mvc *body, dgfem_real h, dgfem_vec3 *rhs, dgfem_mvc_info *info) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 *force = dgfem_mvci_vector(body, DGFEM_MVCI_FORCE);
    double start = dgfem_mvci_clock(&body->hooks);
    dgfem_mvci_rotations(body, system->next);
    dgfem_mvci_assemble_stiffness(body, system->next, h * h + h * body->desc.damping_stiffness);
    dgfem_mvci_forces(body, system->next, force);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_real mass = body->mass[i], *block = system->matrix->values + system->diagonal[i];
        rhs[i] = dgfem_mvci_blend(mass, body->velocity[i], -h, force[i]);
        for (int k = 0; k < 9; k += 4) block[k] += (1 + h * body->desc.damping_mass) * mass;
    }
    dgfem_mvci_add_external(body, h, rhs);
    dgfem_mvci_assemble_pins(body, h * h, h, rhs);
    double middle = dgfem_mvci_clock(&body->hooks);
    info->seconds_assemble += middle - start;
    info->contacts = dgfem_mvci_assemble_contact(body, h, rhs);
    info->seconds_contact += dgfem_mvci_clock(&body->hooks) - middle;
}

static void dgfem_mvci_commit_rotations(dgfem_mvc *body) {
    memcpy(body->rotation, body->system->next, (size_t)body->element_count * sizeof *body->rotation);
}

static dgfem_status dgfem_mvci_step(dgfem_mvc *body, dgfem_real h, dgfem_mvc_info *info) {
    dgfem_vec3 *rhs = dgfem_mvci_vector(body, DGFEM_MVCI_RHS), *v = dgfem_mvci_vector(body, DGFEM_MVCI_SOLUTION);
    size_t size = (size_t)body->node_count * sizeof *v;
    dgfem_status status = dgfem_mvci_prepare_solver(body, 1);
    if (!status) status = dgfem_mvci_collect_held(body, 1);
    if (status) return status;
    dgfem_mvci_assemble_step(body, h, rhs, info);
    memcpy(v, body->velocity, size);
    dgfem_mvci_hold_vector(body, h, v);
    dgfem_mvci_hold_matrix(body, v, rhs);
    status = dgfem_mvci_solve(body, rhs, v, info);
    if (status) return status;
    dgfem_mvci_hold_vector(body, h, v); /* exactly, whatever the solver */
    memcpy(body->velocity, v, size);
    for (int i = 0; i < body->node_count; i++) body->position[i] = dgfem_mvci_axpy(body->position[i], h, v[i]);
    dgfem_mvci_commit_rotations(body);
    body->time += (double)h;
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_step(dgfem_mvc *body, dgfem_real dt, dgfem_mvc_info *info) {
    dgfem_mvc_info local = dgfem_mvci_empty_info();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_check_scalar(&body->hooks, dt, 1, "dt");
    if (!status) status = dgfem_mvci_step(body, dt, &local);
    if (info) *info = local;
    return status;
}

/* ---- what holds the body ---- */

/* root[i]: the lowest node that hangs together with node i. */
static void dgfem_mvci_node_pieces(const dgfem_mvc *body, int *root) {
    const dgfem_mvc_system *system = body->system;
    for (int i = 0; i < body->node_count; i++) root[i] = i;
    for (int e = 0; e < body->element_count; e++)
        for (int k = system->node_start[e]; k < system->node_start[e + 1]; k++)
            dgfem_mvci_join(root, system->nodes[system->node_start[e]], system->nodes[k]);
    for (int i = 0; i < body->node_count; i++) root[i] = dgfem_mvci_root(root, i);
}

/* The conditions on the rigid motions t + w x (x - centre) / size of one piece, as a Gram matrix over (t, w): a motion
   that no condition sees is in its kernel. */
typedef struct dgfem_mvci_hold {
    dgfem_vec3 lower, upper;
    double gram[6][6];
} dgfem_mvci_hold;

/* The axis of a node at x is held. */
static void dgfem_mvci_hold_axis(dgfem_mvci_hold *hold, dgfem_vec3 x, int axis) {
    dgfem_vec3 centre = dgfem_mvci_scale(DGFEM_R(0.5), dgfem_mvci_add(hold->lower, hold->upper));
    dgfem_vec3 e = dgfem_mvci_vec3((dgfem_real)(axis == 0), (dgfem_real)(axis == 1), (dgfem_real)(axis == 2));
    dgfem_vec3 turn = dgfem_mvci_cross(dgfem_mvci_sub(x, centre), e);
    double size = (double)dgfem_mvci_distance(hold->lower, hold->upper), row[6];
    row[0] = axis == 0, row[1] = axis == 1, row[2] = axis == 2;
    row[3] = (double)turn.x / size, row[4] = (double)turn.y / size, row[5] = (double)turn.z / size;
    for (int i = 0; i < 36; i++) hold->gram[i / 6][i % 6] += row[i / 6] * row[i % 6];
}

/* Cholesky. The bound lets a node hold a body of 1e5 times its distance, and is far above round-off in float. */
static int dgfem_mvci_hold_is_complete(dgfem_mvci_hold *hold) {
    const double bound = 1e-10;
    double(*a)[6] = hold->gram, mean = 0;
    for (int j = 0; j < 6; j++) mean += a[j][j] / 6;
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < j; k++) a[j][j] -= a[j][k] * a[j][k];
        if (!(a[j][j] > bound * mean)) return 0;
        a[j][j] = sqrt(a[j][j]);
        for (int i = j + 1; i < 6; i++) {
            for (int k = 0; k < j; k++) a[i][j] -= a[i][k] * a[j][k];
            a[i][j] /= a[j][j];
        }
    }
    return 1;
}

static void dgfem_mvci_extend(dgfem_vec3 *lower, dgfem_vec3 *upper, dgfem_vec3 x) {
    if (x.x < lower->x) lower->x = x.x;
    if (x.y < lower->y) lower->y = x.y;
    if (x.z < lower->z) lower->z = x.z;
    if (x.x > upper->x) upper->x = x.x;
    if (x.y > upper->y) upper->y = x.y;
    if (x.z > upper->z) upper->z = x.z;
}

/* Refuses a body of which a piece is free to move as a rigid one, to first order about its rest position. Needs the
   held axes collected. */
static dgfem_status dgfem_mvci_check_held(const dgfem_mvc *body) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    int *root = (int *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof(int));
    dgfem_mvci_hold *holds = (dgfem_mvci_hold *)dgfem_mvci_take(&scratch, (size_t)body->node_count, sizeof *holds);
    dgfem_status status = root && holds ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
    if (!status) dgfem_mvci_node_pieces(body, root);
    for (int i = 0; !status && i < body->node_count; i++) {
        dgfem_mvci_hold *hold = &holds[root[i]];
        if (root[i] == i) hold->lower = hold->upper = body->rest[i];
        dgfem_mvci_extend(&hold->lower, &hold->upper, body->rest[i]);
    }
    for (int i = 0; !status && i < body->node_count; i++)
        for (int axis = 0; axis < 3; axis++)
            if (body->system->held[i] >> axis & 1) dgfem_mvci_hold_axis(&holds[root[i]], body->rest[i], axis);
    for (int c = 0; !status && c < body->condition_count; c++) {
        const dgfem_mvc_condition *pin = &body->conditions[c];
        for (int i = 0; pin->kind == DGFEM_MVC_CONDITION_PIN && pin->scalar > 0 && i < pin->count; i++)
            for (int axis = 0; axis < 3; axis++)
                dgfem_mvci_hold_axis(&holds[root[pin->items[i]]], body->rest[pin->items[i]], axis);
    }
    for (int i = 0; !status && i < body->node_count; i++)
        if (root[i] == i && !dgfem_mvci_hold_is_complete(&holds[i]))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_UNCONSTRAINED,
                                     "static solve: the conditions leave the piece of node %d free to move or turn", i);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

/* ---- static solve ---- */

static double dgfem_mvci_square_sum(const dgfem_vec3 *a, const dgfem_vec3 *b, int count) {
    double sum = 0;
    for (int i = 0; i < count; i++) {
        double x = (double)a[i].x - (double)b[i].x, y = (double)a[i].y - (double)b[i].y;
        double z = (double)a[i].z - (double)b[i].z;
        sum += x * x + y * y + z * z;
    }
    return sum;
}

/* One correction, K_w d = factor F - f(x), with the rotations of the current positions. info->residual becomes |d| over
   the displacement's size. Solving for the correction makes errors of the solver vanish with it. */
static dgfem_status dgfem_mvci_static_sweep(dgfem_mvc *body, dgfem_real factor, dgfem_mvc_info *info) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 *rhs = dgfem_mvci_vector(body, DGFEM_MVCI_RHS), *d = dgfem_mvci_vector(body, DGFEM_MVCI_SOLUTION);
    dgfem_vec3 *force = dgfem_mvci_vector(body, DGFEM_MVCI_FORCE);
    size_t size = (size_t)body->node_count * sizeof *d;
    double start = dgfem_mvci_clock(&body->hooks);
    dgfem_mvci_rotations(body, system->next);
    dgfem_mvci_assemble_stiffness(body, system->next, 1);
    dgfem_mvci_forces(body, system->next, force);
    for (int i = 0; i < body->node_count; i++) rhs[i] = dgfem_mvci_scale(-1, force[i]);
    dgfem_mvci_add_external(body, factor, rhs);
    dgfem_mvci_assemble_pins(body, 1, 1, rhs);
    memset(d, 0, size);
    dgfem_mvci_hold_vector(body, 1, d);
    dgfem_mvci_hold_matrix(body, d, rhs);
    info->seconds_assemble += dgfem_mvci_clock(&body->hooks) - start;
    dgfem_status status = dgfem_mvci_solve(body, rhs, d, info);
    if (status) return status;
    dgfem_mvci_hold_vector(body, 1, d);
    memset(force, 0, size);
    double change = dgfem_mvci_square_sum(d, force, body->node_count);
    for (int i = 0; i < body->node_count; i++) body->position[i] = dgfem_mvci_add(body->position[i], d[i]);
    double whole = dgfem_mvci_square_sum(body->position, body->rest, body->node_count);
    info->residual = whole > 0 ? (dgfem_real)sqrt(change / whole) : 0;
    dgfem_mvci_commit_rotations(body);
    info->sweeps++;
    return DGFEM_OK;
}

static dgfem_status dgfem_mvci_static_load(dgfem_mvc *body, const dgfem_mvc_static_desc *desc, dgfem_real factor,
                                           dgfem_mvc_info *info) {
    dgfem_status status = dgfem_mvci_collect_held(body, factor);
    for (int sweep = 0; !status && sweep < desc->max_sweeps; sweep++) {
        status = dgfem_mvci_static_sweep(body, factor, info);
        if (!status && info->residual <= desc->tolerance) return DGFEM_OK;
    }
    if (status) return status;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_CONVERGED,
                           "static solve at %g of the load: the displacement still changes by %g after %d sweeps",
                           (double)factor, (double)info->residual, desc->max_sweeps);
}

static dgfem_status dgfem_mvci_solve_static(dgfem_mvc *body, const dgfem_mvc_static_desc *desc, dgfem_mvc_info *info) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    dgfem_vec3 *position = (dgfem_vec3 *)dgfem_mvci_take(&scratch, nodes, sizeof *position);
    dgfem_mat3 *rotation = (dgfem_mat3 *)dgfem_mvci_take(&scratch, elements, sizeof *rotation);
    dgfem_status status = position && rotation ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
    if (!status) {
        memcpy(position, body->position, nodes * sizeof *position);
        memcpy(rotation, body->rotation, elements * sizeof *rotation);
        for (int step = 1; !status && step <= desc->load_steps; step++)
            status = dgfem_mvci_static_load(body, desc, (dgfem_real)step / (dgfem_real)desc->load_steps, info);
        if (status) {
            memcpy(body->position, position, nodes * sizeof *position);
            memcpy(body->rotation, rotation, elements * sizeof *rotation);
        } else {
            memset(body->velocity, 0, nodes * sizeof *body->velocity);
        }
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_mvc_static_desc dgfem_default_mvc_static_desc(void) {
    dgfem_mvc_static_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.load_steps = 1;
    desc.max_sweeps = 60;
    desc.tolerance = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    return desc;
}

DGFEM_API dgfem_status dgfem_mvc_solve_static(dgfem_mvc *body, const dgfem_mvc_static_desc *desc,
                                              dgfem_mvc_info *info) {
    dgfem_mvc_info local = dgfem_mvci_empty_info();
    dgfem_mvc_static_desc standard = dgfem_default_mvc_static_desc();
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    if (desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_scalar(&body->hooks, desc->tolerance, 1, "tolerance");
    if (!status && (desc->load_steps < 1 || desc->max_sweeps < 1))
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d load_steps, %d max_sweeps", desc->load_steps,
                                 desc->max_sweeps);
    if (!status) status = dgfem_mvci_collect_held(body, 1);
    if (!status) status = dgfem_mvci_check_held(body);
    if (!status) status = dgfem_mvci_prepare_solver(body, 1);
    if (!status) status = dgfem_mvci_solve_static(body, desc, &local);
    if (info) *info = local;
    return status;
}

/* ==== query.c ===================================================================================================== */

/* Questions about a body: its mesh, stress, forces, energy, momentum, volume. */

/* ---- mesh ---- */

static int dgfem_mvci_has_face(const dgfem_mvc *body, int face) { return body && face >= 0 && face < body->face_count; }
static int dgfem_mvci_has_element(const dgfem_mvc *body, int e) { return body && e >= 0 && e < body->element_count; }

/* Copies the first `capacity` of `count` integers; returns count. */
static int dgfem_mvci_answer(const int *from, int count, int *to, int capacity) {
    for (int i = 0; to && i < count && i < capacity; i++) to[i] = from[i];
    return count;
}

DGFEM_API int dgfem_mvc_face_nodes(const dgfem_mvc *body, int face, int *nodes, int capacity) {
    int count;
    if (!dgfem_mvci_has_face(body, face)) return 0;
    const int *loop = dgfem_mvci_face_loop(body->mesh, face, &count);
    return dgfem_mvci_answer(loop, count, nodes, capacity);
}

DGFEM_API int dgfem_mvc_face_triangles(const dgfem_mvc *body, int face, int *triangles, int capacity) {
    int count;
    if (!dgfem_mvci_has_face(body, face)) return 0;
    const int *at = dgfem_mvci_face_triangles(body->mesh, face, &count);
    int room = capacity < count ? capacity : count;
    (void)dgfem_mvci_answer(at, 3 * room, triangles, 3 * room);
    return count;
}

DGFEM_API int dgfem_mvc_element_nodes(const dgfem_mvc *body, int element, int *nodes, int capacity) {
    if (!dgfem_mvci_has_element(body, element)) return 0;
    const int *start = body->system->node_start + element;
    return dgfem_mvci_answer(body->system->nodes + start[0], start[1] - start[0], nodes, capacity);
}

DGFEM_API int dgfem_mvc_element_faces(const dgfem_mvc *body, int element, int *faces, int capacity) {
    int count;
    if (!dgfem_mvci_has_element(body, element)) return 0;
    const int *list = dgfem_mvci_element_faces(body->mesh, element, &count);
    for (int k = 0; faces && k < count && k < capacity; k++) faces[k] = list[k] / 2;
    return count;
}

DGFEM_API void dgfem_mvc_face_elements(const dgfem_mvc *body, int face, int elements[2]) {
    if (!elements) return;
    elements[0] = elements[1] = DGFEM_NONE;
    if (!dgfem_mvci_has_face(body, face)) return;
    elements[0] = body->mesh->faces[face].owner[0];
    elements[1] = body->mesh->faces[face].owner[1];
}

static int dgfem_mvci_is_on_plane(const dgfem_mvc *body, int node, dgfem_plane plane, dgfem_real tolerance) {
    return dgfem_mvci_abs(dgfem_mvci_dot(plane.normal, body->rest[node]) - plane.offset) <= tolerance;
}

DGFEM_API int dgfem_mvc_faces_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *faces,
                                       int capacity) {
    int found = 0;
    for (int f = 0; body && f < body->face_count; f++) {
        int count, on = 0;
        const int *loop = dgfem_mvci_face_loop(body->mesh, f, &count);
        if (body->mesh->faces[f].owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < count; i++) on += dgfem_mvci_is_on_plane(body, loop[i], plane, tolerance);
        if (on < count) continue;
        if (faces && found < capacity) faces[found] = f;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_nodes_on_plane(const dgfem_mvc *body, dgfem_plane plane, dgfem_real tolerance, int *nodes,
                                       int capacity) {
    int found = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        if (!dgfem_mvci_is_on_plane(body, i, plane, tolerance)) continue;
        if (nodes && found < capacity) nodes[found] = i;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_boundary_nodes(const dgfem_mvc *body, int *nodes, int capacity) {
    int found = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        if (!(body->area[i] > 0)) continue;
        if (nodes && found < capacity) nodes[found] = i;
        found++;
    }
    return found;
}

DGFEM_API int dgfem_mvc_nearest_node(const dgfem_mvc *body, dgfem_vec3 x) {
    int best = DGFEM_NONE;
    dgfem_real least = 0;
    for (int i = 0; body && i < body->node_count; i++) {
        dgfem_real distance = dgfem_mvci_distance(body->position[i], x);
        if (best == DGFEM_NONE || distance < least) best = i, least = distance;
    }
    return best;
}

/* ---- state ---- */

/* Points given for all nodes. */
static dgfem_status dgfem_mvci_read_nodes(dgfem_mvc *body, const dgfem_points_in *points, const char *what,
                                          dgfem_vec3 *out) {
    dgfem_status status = dgfem_mvci_check_points(&body->hooks, points, what);
    if (!status && points->count != body->node_count)
        status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "%d %s for %d nodes", points->count, what,
                                 body->node_count);
    for (int i = 0; !status && i < points->count; i++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(points, i)))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "%s: node %d", what, i);
    for (int i = 0; !status && i < points->count; i++) out[i] = dgfem_mvci_read_point(points, i);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_set_positions(dgfem_mvc *body, dgfem_points_in positions) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_status status = dgfem_mvci_read_nodes(body, &positions, "positions", body->position);
    if (status) return status;
    dgfem_mvci_rotations(body, body->system->next);
    dgfem_mvci_commit_rotations(body);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_set_velocities(dgfem_mvc *body, dgfem_points_in velocities) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    return dgfem_mvci_read_nodes(body, &velocities, "velocities", body->velocity);
}

static dgfem_status dgfem_mvci_check_question(const dgfem_mvc *body, int element, const void *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    if (dgfem_mvci_has_element(body, element)) return DGFEM_OK;
    return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "element %d of %d", element, body->element_count);
}

static dgfem_mat3 dgfem_mvci_rotation_now(const dgfem_mvc *body, int e) {
    return body->desc.warp ? dgfem_mvci_element_rotation(body, e, body->position) : dgfem_mvci_identity();
}

/* The mean strain in the element's frame. */
static dgfem_mat3 dgfem_mvci_local_strain(const dgfem_mvc *body, int e, const dgfem_mat3 *rotation) {
    const dgfem_mvc_system *system = body->system;
    dgfem_vec3 centre = dgfem_mvci_element_mean(body, e, body->position);
    dgfem_mat3 gradient, strain;
    memset(&gradient, 0, sizeof gradient);
    for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
        dgfem_mvci_add_outer(&gradient, 1,
                             dgfem_mvci_local_displacement(body, e, i - system->node_start[e], rotation, centre),
                             system->mean[i]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) strain.m[i][j] = (gradient.m[i][j] + gradient.m[j][i]) / 2;
    return strain;
}

static dgfem_mat3 dgfem_mvci_turn_tensor(const dgfem_mat3 *rotation, const dgfem_mat3 *tensor) {
    dgfem_mat3 back = dgfem_mvci_transposed(rotation), half = dgfem_mvci_multiply3(tensor, &back);
    return dgfem_mvci_multiply3(rotation, &half);
}

DGFEM_API dgfem_status dgfem_mvc_strain(const dgfem_mvc *body, int element, dgfem_mat3 *out) {
    dgfem_status status = dgfem_mvci_check_question(body, element, out);
    if (status) return status;
    dgfem_mat3 rotation = dgfem_mvci_rotation_now(body, element);
    dgfem_mat3 strain = dgfem_mvci_local_strain(body, element, &rotation);
    *out = dgfem_mvci_turn_tensor(&rotation, &strain);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_stress(const dgfem_mvc *body, int element, dgfem_mat3 *out) {
    dgfem_status status = dgfem_mvc_strain(body, element, out);
    if (status) return status;
    dgfem_real mu = dgfem_mvci_shear(body->material[element]), lambda = dgfem_mvci_lambda(body->material[element]);
    dgfem_real pressure = lambda * (out->m[0][0] + out->m[1][1] + out->m[2][2]);
    for (int i = 0; i < 9; i++) out->m[i / 3][i % 3] = 2 * mu * out->m[i / 3][i % 3] + (i % 4 ? 0 : pressure);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_internal_force(const dgfem_mvc *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_rotations(body, body->system->next);
    dgfem_mvci_forces(body, body->system->next, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_external_force(const dgfem_mvc *body, dgfem_vec3 *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, (size_t)body->node_count * sizeof *out);
    dgfem_mvci_add_external(body, 1, out);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_element_stiffness(const dgfem_mvc *body, int element, dgfem_real *out) {
    dgfem_status status = dgfem_mvci_check_question(body, element, out);
    if (status) return status;
    const dgfem_real *block = body->system->stiffness + 9 * body->system->pair_start[element];
    int n = body->system->node_start[element + 1] - body->system->node_start[element];
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++, block += 9)
            for (int i = 0; i < 9; i++) {
                out[(3 * a + i / 3) * 3 * n + 3 * b + i % 3] = block[i];
                out[(3 * b + i % 3) * 3 * n + 3 * a + i / 3] = block[i];
            }
    return DGFEM_OK;
}

/* ---- sums ---- */

DGFEM_API dgfem_status dgfem_mvc_energy(const dgfem_mvc *body, dgfem_energy *out) {
    if (!body || !out) return DGFEM_ERROR_ARGUMENT;
    memset(out, 0, sizeof *out);
    for (int i = 0; i < body->node_count; i++) {
        out->kinetic += body->mass[i] * dgfem_mvci_dot(body->velocity[i], body->velocity[i]) / 2;
        out->gravity -= body->mass[i] * dgfem_mvci_dot(body->desc.gravity, body->position[i]);
    }
    for (int e = 0; e < body->element_count; e++) {
        dgfem_mat3 rotation = dgfem_mvci_rotation_now(body, e);
        out->elastic += dgfem_mvci_element_push(body, e, &rotation);
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_momentum(const dgfem_mvc *body, dgfem_vec3 *linear, dgfem_vec3 *angular) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (linear) *linear = dgfem_mvci_vec3(0, 0, 0);
    if (angular) *angular = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < body->node_count; i++) {
        dgfem_vec3 p = dgfem_mvci_scale(body->mass[i], body->velocity[i]);
        if (linear) *linear = dgfem_mvci_add(*linear, p);
        if (angular) *angular = dgfem_mvci_add(*angular, dgfem_mvci_cross(body->position[i], p));
    }
    return DGFEM_OK;
}

DGFEM_API dgfem_real dgfem_mvc_mass(const dgfem_mvc *body) {
    dgfem_real sum = 0;
    for (int i = 0; body && i < body->node_count; i++) sum += body->mass[i];
    return sum;
}

DGFEM_API dgfem_real dgfem_mvc_rest_volume(const dgfem_mvc *body) {
    return body ? dgfem_mvci_mesh_volume(body->mesh) : 0;
}

DGFEM_API dgfem_real dgfem_mvc_volume(const dgfem_mvc *body) {
    dgfem_real sum = 0;
    for (int f = 0; body && f < body->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, f, &count);
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_vec3 origin = body->position[0], a = dgfem_mvci_sub(body->position[at[0]], origin);
            sum += dgfem_mvci_dot(a, dgfem_mvci_loop_area(body->position, at, 3)) / 6;
        }
    }
    return sum;
}

/* ==== renew.c ===================================================================================================== */

/* A body takes over an edited copy of its mesh. */

/* Conditions of the body in terms of the new mesh. */
typedef struct dgfem_mvci_transfer {
    const dgfem_mvc *body;
    const dgfem_mvci_mesh *mesh;
    char *mark;      /* [numbers of nodes] those a condition has, and what inherits it */
    int *root;       /* [numbers of nodes] the old node that it is a copy of, or DGFEM_NONE */
    int *copy_start; /* [old nodes + 1] into `copies` */
    int *copies;     /* [new nodes] those that are an old node or copies of it */
    int *items;      /* [new nodes or faces] */
} dgfem_mvci_transfer;

static int dgfem_mvci_transfer_reserve(dgfem_mvci_scratch *scratch, dgfem_mvci_transfer *t) {
    const dgfem_mvci_mesh *mesh = t->mesh;
    size_t numbers = (size_t)(mesh->base_count + mesh->birth_count);
    size_t most = (size_t)(mesh->node_count > mesh->face_count ? mesh->node_count : mesh->face_count);
    size_t old_most = (size_t)(t->body->node_count > t->body->face_count ? t->body->node_count : t->body->face_count);
    t->mark = (char *)dgfem_mvci_take(scratch, numbers > old_most ? numbers : old_most, 1);
    t->root = (int *)dgfem_mvci_take(scratch, numbers, sizeof(int));
    t->copy_start = (int *)dgfem_mvci_take(scratch, (size_t)t->body->node_count + 1, sizeof(int));
    t->copies = (int *)dgfem_mvci_take(scratch, (size_t)mesh->node_count, sizeof(int));
    t->items = (int *)dgfem_mvci_take(scratch, most, sizeof(int));
    return t->mark && t->root && t->copy_start && t->copies && t->items;
}

static void dgfem_mvci_trace_copies(dgfem_mvci_transfer *t) {
    const dgfem_mvci_mesh *mesh = t->mesh;
    for (int i = 0; i < mesh->base_count; i++) t->root[i] = i;
    for (int b = 0; b < mesh->birth_count; b++) {
        const int *parent = mesh->births[b].parent;
        t->root[mesh->base_count + b] = parent[1] == DGFEM_NONE ? t->root[parent[0]] : DGFEM_NONE;
    }
    for (int i = 0; i < mesh->node_count; i++) t->items[i] = t->root[mesh->origin[i]];
    dgfem_mvci_list_places(t->items, mesh->node_count, t->body->node_count, t->copy_start, t->copies);
}

/* Fixtures hold what inherits from their nodes. Returns the number of items. */
static int dgfem_mvci_transfer_nodes(dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition) {
    int count = 0;
    memset(t->mark, 0, (size_t)t->mesh->base_count);
    for (int i = 0; i < condition->count; i++) t->mark[condition->items[i]] = 1;
    dgfem_mvci_mesh_inherit(t->mesh, t->mark);
    for (int i = 0; i < t->mesh->node_count; i++)
        if (t->mark[t->mesh->origin[i]]) t->items[count++] = i;
    return count;
}

static int dgfem_mvci_transfer_faces(dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition) {
    int count = 0;
    memset(t->mark, 0, (size_t)t->body->face_count);
    for (int i = 0; i < condition->count; i++) t->mark[condition->items[i]] = 1;
    for (int f = 0; f < t->mesh->face_count; f++) {
        const dgfem_mvci_face *face = &t->mesh->faces[f];
        if (face->owner[1] == DGFEM_NONE && !face->wall && face->from != DGFEM_NONE && t->mark[face->from])
            t->items[count++] = f;
    }
    return count;
}

/* Copies of a node share its force or spring. Returns the number of items; they and their shares are written unless
   NULL. A node may be listed often: there may be more items than nodes. */
static int dgfem_mvci_transfer_copies(const dgfem_mvci_transfer *t, const dgfem_mvc_condition *condition, int *items,
                                      dgfem_real *share) {
    int count = 0;
    for (int k = 0; k < condition->count; k++) {
        int start = t->copy_start[condition->items[k]], end = t->copy_start[condition->items[k] + 1];
        for (int i = start; i < end; i++, count++) {
            if (items) items[count] = t->copies[i];
            if (share) share[count] = condition->share[k] / (dgfem_real)(end - start);
        }
    }
    return count;
}

/* *to is a copy of the condition for the new mesh; 0 when out of memory. */
static int dgfem_mvci_transfer_condition(dgfem_mvci_transfer *t, const dgfem_mvc_condition *from,
                                         dgfem_mvc_condition *to) {
    const dgfem_hooks *hooks = &t->body->hooks;
    *to = *from;
    to->items = NULL, to->share = NULL;
    if (from->share) {
        to->count = dgfem_mvci_transfer_copies(t, from, NULL, NULL);
        to->items = (int *)dgfem_mvci_allocate(hooks, (size_t)to->count, sizeof(int));
        to->share = (dgfem_real *)dgfem_mvci_allocate(hooks, (size_t)to->count, sizeof(dgfem_real));
        if (!to->items || !to->share) return 0;
        (void)dgfem_mvci_transfer_copies(t, from, to->items, to->share);
        return 1;
    }
    to->count = dgfem_mvci_is_face_load(from) ? dgfem_mvci_transfer_faces(t, from) : dgfem_mvci_transfer_nodes(t, from);
    to->items = (int *)dgfem_mvci_duplicate(hooks, t->items, (size_t)to->count, sizeof(int));
    return to->items != NULL;
}

/* next->conditions: those of the body for the new mesh. */
static dgfem_status dgfem_mvci_transfer_conditions(const dgfem_mvc *body, const dgfem_mvci_mesh *mesh,
                                                   dgfem_mvc *next) {
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvci_transfer transfer;
    memset(&transfer, 0, sizeof transfer);
    transfer.body = body, transfer.mesh = mesh;
    next->conditions = (dgfem_mvc_condition *)dgfem_mvci_allocate(&body->hooks, (size_t)body->condition_capacity,
                                                                  sizeof *next->conditions);
    next->condition_count = 0;
    int ok = next->conditions && dgfem_mvci_transfer_reserve(&scratch, &transfer);
    if (ok) dgfem_mvci_trace_copies(&transfer);
    for (int c = 0; ok && c < body->condition_count; c++) {
        next->condition_count = c + 1; /* half made ones are freed with the rest */
        ok = dgfem_mvci_transfer_condition(&transfer, &body->conditions[c], &next->conditions[c]);
    }
    dgfem_mvci_scratch_free(&scratch);
    return ok ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
}

/* Makes an edited, compacted copy of its mesh the body's: state and origin of nodes, faces and elements are those that
   the mesh records since dgfem_mvci_mesh_begin. Elements that have not changed keep their integrals; conditions stay
   where they were; the matrix and its symbolic factorization are left to the next step or solve. On success the mesh is
   the body's, and its history begins anew; on failure nothing has changed and the mesh is still the caller's. */
static dgfem_status dgfem_mvci_body_accept_mesh(dgfem_mvc *body, dgfem_mvci_mesh *mesh) {
    dgfem_mvc next = *body;
    next.mass = next.area = next.modulus = next.volume = NULL;
    next.material = NULL;
    next.tag = NULL;
    next.centre = NULL;
    next.rotation = NULL;
    next.system = NULL;
    next.conditions = NULL;
    next.condition_count = 0;
    dgfem_mvci_adopt_mesh(&next, mesh);
    dgfem_status status = dgfem_mvci_build_topology(&next, NULL, body);
    if (!status) status = dgfem_mvci_transfer_conditions(body, mesh, &next);
    if (status) {
        dgfem_mvci_free_topology(&next);
        dgfem_mvci_free_conditions(&body->hooks, next.conditions, next.condition_count);
        return status;
    }
    dgfem_mvci_free_topology(body);
    dgfem_mvci_free_conditions(&body->hooks, body->conditions, body->condition_count);
    dgfem_mvci_mesh_destroy(body->mesh);
    *body = next;
    body->revision++;
    dgfem_mvci_mesh_begin(body->mesh);
    return DGFEM_OK;
}

/* ==== split.c ===================================================================================================== */

/* Splitting elements by a plane.

   Nodes are below (-1), on (0) or above (1) the plane. A node near the crossing of one of its edges counts as on it, in
   place: so no short edges are made, and the parts meet the plane only nearly. Every crossed edge of an element that is
   split gets one node, in the loops of all faces that have this edge, so that neighbours gain a hanging node:

        + ----- + ------- +          The faces between are divided for both their elements; the new face closes the
        |       |         |          boundary of the faces above. Where a part is not star-shaped, the attempt is
        o ----- o         |          dropped, and repeated with less snapping at the element that failed, then
        |       |         |          without splitting it, at last with nothing new on any of its edges. */

/* The least snapping: what a crossing nearer to a node than this part of its edge cuts off is too flat to be a part. */
#if DGFEM_REAL_IS_FLOAT
#define DGFEM_MVC_TIE 1e-4
#else
#define DGFEM_MVC_TIE 1e-6
#endif

/* Signed distances of nodes from a blade. Zeroed memory is empty. */
typedef struct dgfem_mvci_levels {
    dgfem_real *value;
    signed char *sign; /* of the value, or 0 where the node counts as on the blade */
    int count, capacity;
} dgfem_mvci_levels;

/* What is asked of an element, the more the more often it has failed. Stages below DGFEM_MVCI_WHOLE lower the tolerance
   of its nodes, the last of them to the least. */
enum {
    DGFEM_MVCI_WHOLE = 5, /* stays whole: it is not split, and its faces are not divided */
    DGFEM_MVCI_SEALED     /* gets no new node, either; so all elements that share an edge with it stay whole */
};

/* One attempt, and what earlier ones have learned. */
typedef struct dgfem_mvci_splitter {
    const dgfem_hooks *hooks;
    dgfem_plane plane; /* unit normal */
    int current;       /* 1: the plane is meant in the current positions; 0: at rest */
    dgfem_real snap;
    dgfem_real *tolerance; /* [nodes before] part of a crossed edge within which the node counts as on the plane */
    char *stage;           /* [elements before] */
    const dgfem_mvci_mesh *before;
    int node_count, element_count; /* before the attempt */
    dgfem_mvci_levels levels;
    dgfem_mvci_ints parent;   /* element before the attempt that an element is part of */
    dgfem_mvci_ints failed;   /* elements before the attempt */
    dgfem_mvci_ints selected; /* elements to split */
    dgfem_mvci_ints buffer, list, group, root, bound;
    dgfem_mvci_edges crossings, sides;
    dgfem_mvci_edges sealed; /* edges of elements at the last stage */
    int elements_split, elements_kept, nodes_added;
} dgfem_mvci_splitter;

static int dgfem_mvci_sign(dgfem_real x) { return (x > 0) - (x < 0); }

static int dgfem_mvci_levels_room(const dgfem_hooks *hooks, dgfem_mvci_levels *levels, int count) {
    if (count > levels->capacity) {
        int capacity = levels->capacity, other = capacity, extra = count - levels->count;
        void *value = levels->value, *sign = levels->sign;
        int ok = dgfem_mvci_room(hooks, &value, levels->count, &capacity, extra, sizeof(dgfem_real)) &&
                 dgfem_mvci_room(hooks, &sign, levels->count, &other, extra, 1);
        levels->value = (dgfem_real *)value, levels->sign = (signed char *)sign;
        if (!ok) return 0;
        levels->capacity = capacity;
    }
    for (; levels->count < count; levels->count++) levels->value[levels->count] = 0, levels->sign[levels->count] = 0;
    return 1;
}

static void dgfem_mvci_levels_free(const dgfem_hooks *hooks, dgfem_mvci_levels *levels) {
    dgfem_mvci_free(hooks, levels->value);
    dgfem_mvci_free(hooks, levels->sign);
}

static void dgfem_mvci_splitter_free(dgfem_mvci_splitter *s) {
    const dgfem_hooks *hooks = s->hooks;
    dgfem_mvci_free(hooks, s->tolerance);
    dgfem_mvci_free(hooks, s->stage);
    dgfem_mvci_levels_free(hooks, &s->levels);
    dgfem_mvci_free(hooks, s->parent.data);
    dgfem_mvci_free(hooks, s->failed.data);
    dgfem_mvci_free(hooks, s->selected.data);
    dgfem_mvci_free(hooks, s->buffer.data);
    dgfem_mvci_free(hooks, s->list.data);
    dgfem_mvci_free(hooks, s->group.data);
    dgfem_mvci_free(hooks, s->root.data);
    dgfem_mvci_free(hooks, s->bound.data);
    dgfem_mvci_free(hooks, s->crossings.slots);
    dgfem_mvci_free(hooks, s->sides.slots);
    dgfem_mvci_free(hooks, s->sealed.slots);
}

/* For all attempts on a mesh. 0 when out of memory. */
static int dgfem_mvci_splitter_make(dgfem_mvci_splitter *s, const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh,
                                    dgfem_plane plane, int current, dgfem_real snap) {
    memset(s, 0, sizeof *s);
    s->hooks = hooks;
    s->plane = plane;
    s->current = current;
    s->snap = dgfem_mvci_max(snap, (dgfem_real)DGFEM_MVC_TIE);
    s->node_count = mesh->node_count;
    s->element_count = mesh->element_count;
    s->tolerance = (dgfem_real *)dgfem_mvci_allocate(s->hooks, (size_t)mesh->node_count, sizeof(dgfem_real));
    s->stage = (char *)dgfem_mvci_allocate(s->hooks, (size_t)mesh->element_count, 1);
    s->before = mesh;
    for (int i = 0; s->tolerance && i < mesh->node_count; i++) s->tolerance[i] = s->snap;
    return s->tolerance && s->stage;
}

static const dgfem_vec3 *dgfem_mvci_blade_space(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    return s->current ? mesh->position : mesh->rest;
}

/* Element before the attempt. */
static int dgfem_mvci_element_before(const dgfem_mvci_splitter *s, int element) {
    return element < s->element_count ? element : s->parent.data[element - s->element_count];
}

static int dgfem_mvci_stays_whole(const dgfem_mvci_splitter *s, int element) {
    return s->stage[dgfem_mvci_element_before(s, element)] >= DGFEM_MVCI_WHOLE;
}

static int dgfem_mvci_is_sealed(const dgfem_mvci_splitter *s, int element) {
    return s->stage[dgfem_mvci_element_before(s, element)] == DGFEM_MVCI_SEALED;
}

static int dgfem_mvci_edge_is_sealed(const dgfem_mvci_splitter *s, int a, int b) {
    return s->sealed.size && dgfem_mvci_edges_find_between(&s->sealed, a, b) != DGFEM_NONE;
}

static int dgfem_mvci_add_failed(dgfem_mvci_splitter *s, int element) {
    int before = dgfem_mvci_element_before(s, element);
    for (int i = 0; i < s->failed.count; i++)
        if (s->failed.data[i] == before) return 1;
    return dgfem_mvci_push(s->hooks, &s->failed, before);
}

/* ---- which side nodes are on ---- */

/* Distances of all nodes; round-off counts as none. 0 when out of memory. */
static int dgfem_mvci_measure_levels(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    dgfem_real size = dgfem_mvci_abs(s->plane.offset);
    s->levels.count = 0;
    if (!dgfem_mvci_levels_room(s->hooks, &s->levels, mesh->node_count)) return 0;
    for (int i = 0; i < mesh->node_count; i++) {
        s->levels.value[i] = dgfem_mvci_dot(s->plane.normal, x[i]) - s->plane.offset;
        size = dgfem_mvci_max(size, dgfem_mvci_norm(x[i]));
    }
    for (int i = 0; i < mesh->node_count; i++) {
        if (dgfem_mvci_abs(s->levels.value[i]) <= 64 * DGFEM_MVC_EPSILON * size) s->levels.value[i] = 0;
        s->levels.sign[i] = (signed char)dgfem_mvci_sign(s->levels.value[i]);
    }
    return 1;
}

static dgfem_real dgfem_mvci_node_tolerance(const dgfem_mvci_splitter *s, int node) {
    return node < s->node_count ? s->tolerance[node] : s->snap;
}

/* Puts the nodes of a face on the blade where it crosses an edge near them. */
static void dgfem_mvci_snap_face(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face,
                                 dgfem_mvci_levels *levels) {
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int a = loop[i], b = loop[(i + 1) % count];
        if (levels->sign[a] * levels->sign[b] >= 0) continue;
        dgfem_real t = levels->value[a] / (levels->value[a] - levels->value[b]);
        if (t <= dgfem_mvci_node_tolerance(s, a)) levels->sign[a] = 0;
        else if (1 - t <= dgfem_mvci_node_tolerance(s, b)) levels->sign[b] = 0;
    }
}

/* Puts nodes between two others of a face on the blade where these are and all lie nearly on a line: what would be cut
   off there has no height. Returns whether it did. */
static int dgfem_mvci_snap_between(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face,
                                   dgfem_mvci_levels *levels) {
    const dgfem_real least = (dgfem_real)(1000 * DGFEM_MVC_FLAT);
    int count, changed = 0;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int n = 1;
        if (levels->sign[loop[i]] || !levels->sign[loop[(i + 1) % count]]) continue;
        while (n < count && levels->sign[loop[(i + n) % count]]) n++;
        if (n >= count - 1) continue;
        dgfem_vec3 a = mesh->rest[loop[i]], d = dgfem_mvci_sub(mesh->rest[loop[(i + n) % count]], a);
        dgfem_real square = dgfem_mvci_dot(d, d);
        int flat = 1;
        for (int k = 1; k < n && flat; k++) {
            int node = loop[(i + k) % count];
            dgfem_real limit = dgfem_mvci_max(least, dgfem_mvci_node_tolerance(s, node) / 20);
            flat = dgfem_mvci_norm(dgfem_mvci_cross(d, dgfem_mvci_sub(mesh->rest[node], a))) <= limit * square;
        }
        if (!flat) continue;
        for (int k = 1; k < n; k++) levels->sign[loop[(i + k) % count]] = 0;
        changed = 1;
    }
    return changed;
}

/* Number of changes of side along a loop, nodes on the blade left out. */
static int dgfem_mvci_face_changes(const dgfem_mvci_mesh *mesh, int face, const dgfem_mvci_levels *levels) {
    int count, last = 0, first = 0, changes = 0;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    for (int i = 0; i < count; i++) {
        int sign = levels->sign[loop[i]];
        if (!sign) continue;
        if (last && sign != last) changes++;
        if (!first) first = sign;
        last = sign;
    }
    return changes + (first != last);
}

static int dgfem_mvci_element_straddles(const dgfem_mvci_mesh *mesh, int element, const dgfem_mvci_levels *levels) {
    int face_count, above = 0, below = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    for (int k = 0; k < face_count && !(above && below); k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) above |= levels->sign[loop[i]] > 0, below |= levels->sign[loop[i]] < 0;
    }
    return above && below;
}

/* ---- edges and faces ---- */

/* Snaps the nodes of the selected elements, and drops those that no longer straddle. */
static void dgfem_mvci_snap_selected(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    int changed = 1, kept = 0;
    for (int i = 0; i < s->selected.count; i++) {
        int face_count;
        const int *faces = dgfem_mvci_element_faces(mesh, s->selected.data[i], &face_count);
        for (int k = 0; k < face_count; k++) dgfem_mvci_snap_face(s, mesh, faces[k] / 2, &s->levels);
    }
    while (changed) {
        changed = 0;
        for (int i = 0; i < s->selected.count; i++) {
            int face_count;
            const int *faces = dgfem_mvci_element_faces(mesh, s->selected.data[i], &face_count);
            for (int k = 0; k < face_count; k++) changed |= dgfem_mvci_snap_between(s, mesh, faces[k] / 2, &s->levels);
        }
    }
    for (int i = 0; i < s->selected.count; i++)
        if (dgfem_mvci_element_straddles(mesh, s->selected.data[i], &s->levels))
            s->selected.data[kept++] = s->selected.data[i];
    s->selected.count = kept;
}

/* Divides faces of an element that the blade would cut into more than two. 0 when out of memory. */
static int dgfem_mvci_divide_crossed(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    for (int k = 0; k < mesh->elements[element].face_count; k++) {
        int face = mesh->element_faces.data[mesh->elements[element].face + k] / 2;
        if (dgfem_mvci_face_changes(mesh, face, &s->levels) <= 2) continue;
        int count = mesh->faces[face].triangle_count;
        s->buffer.count = 0;
        if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->triangles.data + mesh->faces[face].triangle, 3 * count) ==
                DGFEM_NONE ||
            !dgfem_mvci_divide_face(mesh, face, s->buffer.data, count))
            return 0;
    }
    return 1;
}

/* A node where the blade crosses the edge from a to b; 0 when out of memory. */
static int dgfem_mvci_cross_edge(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_levels *levels, int a,
                                 int b) {
    dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->crossings, a, b);
    if (edge->value != DGFEM_NONE) return 1;
    dgfem_real t = levels->value[edge->a] / (levels->value[edge->a] - levels->value[edge->b]);
    edge->value = dgfem_mvci_add_node_between(mesh, edge->a, edge->b, t);
    s->nodes_added++;
    return edge->value != DGFEM_NONE && dgfem_mvci_levels_room(s->hooks, levels, mesh->node_count);
}

static int dgfem_mvci_cross_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_levels *levels, int face) {
    for (int i = 0; i < mesh->faces[face].count; i++) {
        const int *loop = mesh->loops.data + mesh->faces[face].loop;
        int a = loop[i], b = loop[(i + 1) % mesh->faces[face].count];
        if (levels->sign[a] * levels->sign[b] < 0 && !dgfem_mvci_cross_edge(s, mesh, levels, a, b)) return 0;
    }
    return 1;
}

/* Puts the nodes of s->crossings into the loops of all faces that have their edges. 0 when out of memory. */
static int dgfem_mvci_insert_nodes(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    for (int f = 0; f < mesh->face_count; f++) {
        int count, found = 0;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count);
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, 2 * count)) return 0;
        for (int i = 0; i < count; i++) {
            int node = dgfem_mvci_edges_find_between(&s->crossings, loop[i], loop[(i + 1) % count]);
            s->buffer.data[s->buffer.count++] = loop[i];
            if (node != DGFEM_NONE) s->buffer.data[s->buffer.count++] = node, found = 1;
        }
        if (found && !dgfem_mvci_set_loop(mesh, f, s->buffer.data, s->buffer.count)) return 0;
    }
    return 1;
}

/* Position of the node nearest to the blade among `count` in a row, from `first` on. */
static int dgfem_mvci_nearest_level(const dgfem_mvci_levels *levels, const int *loop, int length, int first,
                                    int count) {
    int best = first;
    for (int i = 1; i < count; i++)
        if (dgfem_mvci_abs(levels->value[loop[(first + i) % length]]) <
            dgfem_mvci_abs(levels->value[loop[best % length]]))
            best = first + i;
    return best;
}

/* Divides a face, with two changes of side and nodes on the blade at both, by a chord between these. The part above
   stays in place. Returns the part below; the face itself where a part would be turned over, for it is not convex and
   the chord outside: nothing has changed then; DGFEM_NONE when out of memory. */
static int dgfem_mvci_split_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int face,
                                 const dgfem_mvci_levels *levels) {
    dgfem_mvci_face old = mesh->faces[face];
    int n = old.count, start = 0, end, up, down;
    const int *loop = mesh->loops.data + old.loop;
    while (levels->sign[loop[start]] >= 0) start++; /* one below, */
    for (up = start; levels->sign[loop[up % n]] <= 0;) up++;
    while (levels->sign[loop[(up + n - 1) % n]] == 0) up--; /* the first behind the last below, */
    for (down = up; levels->sign[loop[down % n]] >= 0;) down++;
    end = down; /* and the next below */
    while (levels->sign[loop[(down + n - 1) % n]] == 0) down--;
    int zeros = 0;
    while (levels->sign[loop[(up + zeros) % n]] == 0) zeros++;
    if (!zeros || end == down) return face; /* a crossed edge without a node: nothing to divide by */
    int first = dgfem_mvci_nearest_level(levels, loop, n, up, zeros);
    int last = dgfem_mvci_nearest_level(levels, loop, n, down, end - down);
    s->buffer.count = 0;
    if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, n + 4)) return DGFEM_NONE;
    for (int i = first; i <= last; i++) s->buffer.data[s->buffer.count++] = loop[i % n];
    int above = s->buffer.count;
    for (int i = last; i <= first + n; i++) s->buffer.data[s->buffer.count++] = loop[i % n];
    dgfem_vec3 normal = dgfem_mvci_loop_area(mesh->rest, loop, n);
    dgfem_vec3 part_above = dgfem_mvci_loop_area(mesh->rest, s->buffer.data, above);
    dgfem_vec3 part_below = dgfem_mvci_loop_area(mesh->rest, s->buffer.data + above, s->buffer.count - above);
    if (!(dgfem_mvci_dot(part_above, normal) > 0) || !(dgfem_mvci_dot(part_below, normal) > 0)) return face;
    if (!dgfem_mvci_set_loop(mesh, face, s->buffer.data, above)) return DGFEM_NONE;
    int part = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], s->buffer.data + above, s->buffer.count - above,
                                   old.from, old.wall);
    if (part == DGFEM_NONE) return DGFEM_NONE;
    for (int side = 0; side < 2; side++)
        if (old.owner[side] != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, old.owner[side], part, side))
            return DGFEM_NONE;
    return part;
}

/* ---- elements ---- */

/* 1 above, -1 below. A face on the blade belongs to the side on which the element's inside is. */
static int dgfem_mvci_face_side(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int entry) {
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, entry / 2, &count);
    for (int i = 0; i < count; i++)
        if (s->levels.sign[loop[i]]) return s->levels.sign[loop[i]];
    dgfem_vec3 area = dgfem_mvci_loop_area(dgfem_mvci_blade_space(s, mesh), loop, count);
    dgfem_real up = dgfem_mvci_dot(area, s->plane.normal);
    return (entry & 1 ? -up : up) > 0 ? -1 : 1;
}

/* s->list: the element's faces, s->group: their sides, s->root: connected ones of a side, s->sides: position in the
   list by directed edge. 0 when out of memory, -1 where edges do not match. */
static int dgfem_mvci_group_faces(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    s->list.count = s->group.count = s->root.count = 0;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->sides, dgfem_mvci_element_corners(mesh, element))) return 0;
    for (int k = 0; k < face_count; k++)
        if (!dgfem_mvci_push(s->hooks, &s->list, faces[k]) || !dgfem_mvci_push(s->hooks, &s->root, k) ||
            !dgfem_mvci_push(s->hooks, &s->group, dgfem_mvci_face_side(s, mesh, faces[k])))
            return 0;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < face_count; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
            for (int i = 0; i < count; i++) {
                int j = (i + 1) % count, a = loop[faces[k] & 1 ? j : i], b = loop[faces[k] & 1 ? i : j];
                if (!pass) {
                    dgfem_mvci_edges_at(&s->sides, a, b)->value = k;
                    continue;
                }
                int other = dgfem_mvci_edges_find(&s->sides, b, a);
                if (other == DGFEM_NONE) return -1;
                if (s->group.data[other] == s->group.data[k])
                    s->root.data[dgfem_mvci_root(s->root.data, other)] = dgfem_mvci_root(s->root.data, k);
            }
        }
    return 1;
}

/* s->bound: edges between the faces above and those below, as seen from the latter: start, end, face above, face below.
   Returns 0 when out of memory, -1 where two start at the same node. */
static int dgfem_mvci_find_bound(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    s->bound.count = 0;
    for (int k = 0; k < s->list.count; k++) {
        int count, entry = s->list.data[k];
        const int *loop = dgfem_mvci_face_loop(mesh, entry / 2, &count);
        if (s->group.data[k] > 0) continue;
        for (int i = 0; i < count; i++) {
            int j = (i + 1) % count, a = loop[entry & 1 ? j : i], b = loop[entry & 1 ? i : j];
            int other = dgfem_mvci_edges_find(&s->sides, b, a);
            if (s->group.data[other] < 0) continue;
            for (int l = 0; l < s->bound.count; l += 4)
                if (s->bound.data[l] == a) return -1;
            if (!dgfem_mvci_ints_room(s->hooks, &s->bound, 4)) return 0;
            int *edge = s->bound.data + s->bound.count;
            edge[0] = a, edge[1] = b, edge[2] = other, edge[3] = k;
            s->bound.count += 4;
        }
    }
    return 1;
}

/* Makes an element of each class of faces, the first of those above in place of the old one. s->group becomes the
   element of each class at its root. */
static int dgfem_mvci_make_parts(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    int from = mesh->elements[element].from, before = dgfem_mvci_element_before(s, element), used = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < s->list.count; k++) {
            int part = element;
            if (s->root.data[k] != k || (s->group.data[k] > 0) != !pass) continue;
            if (used++) part = dgfem_mvci_add_element(mesh, from);
            if (part == DGFEM_NONE) return 0;
            if (part != element && !dgfem_mvci_push(s->hooks, &s->parent, before)) return 0;
            s->group.data[k] = pass ? -2 - part : 2 + part; /* not taken for a side */
        }
    return 1;
}

static int dgfem_mvci_part_of(const dgfem_mvci_splitter *s, int k) {
    int value = s->group.data[dgfem_mvci_root(s->root.data, k)];
    return value < 0 ? -2 - value : value - 2;
}

/* Distributes the element's faces among its parts, and adds a face for each cycle of s->bound. Returns 0 when out of
   memory, -1 where the cycles are not good. */
static int dgfem_mvci_close_parts(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    mesh->elements[element].face_count = 0;
    for (int k = 0; k < s->list.count; k++) {
        int entry = s->list.data[k], part = dgfem_mvci_part_of(s, k);
        mesh->faces[entry / 2].owner[entry & 1] = part;
        if (!dgfem_mvci_add_element_face(mesh, part, entry / 2, entry & 1)) return 0;
    }
    for (int l = 0; l < s->bound.count; l += 4) {
        int at = l, above = dgfem_mvci_part_of(s, s->bound.data[l + 2]);
        int below = dgfem_mvci_part_of(s, s->bound.data[l + 3]);
        if (s->bound.data[l] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        for (;;) { /* the cycle runs as the new face does, seen from outside of the part above */
            int next = s->bound.data[at + 1];
            if (dgfem_mvci_part_of(s, s->bound.data[at + 2]) != above ||
                dgfem_mvci_part_of(s, s->bound.data[at + 3]) != below)
                return -1;
            if (!dgfem_mvci_push(s->hooks, &s->buffer, s->bound.data[at])) return 0;
            s->bound.data[at] = DGFEM_NONE;
            if (next == s->buffer.data[0]) break;
            for (at = 0; at < s->bound.count && s->bound.data[at] != next;) at += 4;
            if (at >= s->bound.count) return -1;
        }
        if (s->buffer.count < 3) return -1;
        int face = dgfem_mvci_add_face(mesh, above, below, s->buffer.data, s->buffer.count, DGFEM_NONE, 0);
        if (face == DGFEM_NONE || !dgfem_mvci_add_element_face(mesh, above, face, 0) ||
            !dgfem_mvci_add_element_face(mesh, below, face, 1))
            return 0;
    }
    return 1;
}

/* Returns 0 when out of memory, -1 where the element cannot be split: the mesh is spoilt then. */
static int dgfem_mvci_split_element(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, int element) {
    int result = dgfem_mvci_group_faces(s, mesh, element);
    if (result > 0) result = dgfem_mvci_find_bound(s, mesh);
    if (result <= 0) return result;
    for (int k = 0; k < s->list.count; k++) s->root.data[k] = dgfem_mvci_root(s->root.data, k);
    if (!dgfem_mvci_make_parts(s, mesh, element)) return 0;
    return dgfem_mvci_close_parts(s, mesh, element);
}

/* ---- guards ---- */

/* Least height of an element's centroid above its triangles, relative to its diameter; not positive where it does not
   see one of them, or where round-off decides whether it does. */
static dgfem_real dgfem_mvci_element_height(const dgfem_mvci_mesh *mesh, int element) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    dgfem_vec3 centre;
    dgfem_real diameter, least = 1, volume = dgfem_mvci_element_measure(mesh, element, &centre);
    if (!(volume > 0)) return 0;
    (void)dgfem_mvci_element_area(mesh, element, &diameter);
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, nodes, 3));
            dgfem_real height = dgfem_mvci_tetrahedron(mesh, nodes, centre) / (diameter * area);
            if (!(height >= least)) least = height > 0 ? height : 0;
        }
    return least > 64 * DGFEM_MVC_EPSILON * (1 + dgfem_mvci_norm(centre) / diameter) ? least : 0;
}

/* Whether an element's centroid sees all its triangles, from a height that is not just round-off. */
static int dgfem_mvci_element_is_good(const dgfem_mvci_mesh *mesh, int element) {
    return dgfem_mvci_element_height(mesh, element) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-7));
}

/* Whether each directed edge of an element's triangles is there once, and once the other way, and the triangles are as
   many as on a sphere. Negative when out of memory. */
static int dgfem_mvci_element_is_closed(const dgfem_mvci_mesh *mesh, int element, dgfem_mvci_edges *edges) {
    int face_count, corner[3], triangles = 0, nodes = 0;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    if (!dgfem_mvci_edges_reset(&mesh->hooks, edges, 4 * dgfem_mvci_element_corners(mesh, element))) return -1;
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < face_count; k++)
            for (int t = 0; t < mesh->faces[faces[k] / 2].triangle_count; t++) {
                dgfem_mvci_triangle(mesh, faces[k] / 2, faces[k] & 1, t, corner);
                triangles += !pass;
                for (int i = 0; i < 3; i++) {
                    int a = corner[i], b = corner[(i + 1) % 3];
                    if (pass && dgfem_mvci_edges_find(edges, b, a) == DGFEM_NONE) return 0;
                    if (pass) continue;
                    if (!dgfem_mvci_check_edge(edges, a, b)) return 0;
                    nodes += dgfem_mvci_check_edge(edges, a, a);
                }
            }
    return triangles == 2 * nodes - 4;
}

/* Triangulates what is new. DGFEM_ERROR_DEGENERATE where elements failed. */
static dgfem_status dgfem_mvci_settle_attempt(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    s->list.count = 0;
    dgfem_status status = dgfem_mvci_mesh_settle(mesh, &s->list);
    if (status == DGFEM_ERROR_MEMORY) return status;
    for (int i = 0; i < s->list.count; i++)
        for (int side = 0; side < 2; side++) {
            int owner = mesh->faces[s->list.data[i]].owner[side];
            if (owner != DGFEM_NONE && !dgfem_mvci_add_failed(s, owner)) return DGFEM_ERROR_MEMORY;
        }
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Divides the faces of the selected elements that have nodes on both sides. */
static dgfem_status dgfem_mvci_split_faces(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    for (int i = 0; i < s->selected.count; i++)
        for (int k = 0; k < mesh->elements[s->selected.data[i]].face_count; k++) {
            int face = mesh->element_faces.data[mesh->elements[s->selected.data[i]].face + k] / 2;
            if (dgfem_mvci_face_changes(mesh, face, &s->levels) != 2) continue;
            int part = dgfem_mvci_split_face(s, mesh, face, &s->levels);
            if (part == DGFEM_NONE) return DGFEM_ERROR_MEMORY;
            if (part != face) continue;
            if (!dgfem_mvci_add_failed(s, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
            break;
        }
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Splits the selected elements. DGFEM_ERROR_DEGENERATE with s->failed where some cannot be: the mesh is spoilt then. */
static dgfem_status dgfem_mvci_split_selected(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh) {
    int corners = 0, first = mesh->element_count;
    s->parent.count = s->failed.count = 0;
    s->elements_split = s->nodes_added = 0;
    dgfem_mvci_snap_selected(s, mesh);
    if (!s->selected.count) return DGFEM_OK;
    for (int i = 0; i < s->selected.count; i++)
        if (!dgfem_mvci_divide_crossed(s, mesh, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < s->selected.count; i++) corners += dgfem_mvci_element_corners(mesh, s->selected.data[i]);
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return DGFEM_ERROR_MEMORY;
    for (int i = 0; i < s->selected.count; i++)
        for (int k = 0; k < mesh->elements[s->selected.data[i]].face_count; k++) {
            int entry = mesh->element_faces.data[mesh->elements[s->selected.data[i]].face + k];
            if (!dgfem_mvci_cross_face(s, mesh, &s->levels, entry / 2)) return DGFEM_ERROR_MEMORY;
        }
    if (!dgfem_mvci_insert_nodes(s, mesh)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_mvci_split_faces(s, mesh);
    for (int i = 0; !status && i < s->selected.count; i++) {
        int result = dgfem_mvci_split_element(s, mesh, s->selected.data[i]);
        if (!result) return DGFEM_ERROR_MEMORY;
        if (result < 0 && !dgfem_mvci_add_failed(s, s->selected.data[i])) return DGFEM_ERROR_MEMORY;
    }
    if (!status && s->failed.count) status = DGFEM_ERROR_DEGENERATE;
    if (!status) status = dgfem_mvci_settle_attempt(s, mesh);
    if (status) return status;
    for (int i = 0; i < s->selected.count + mesh->element_count - first; i++) {
        int e = i < s->selected.count ? s->selected.data[i] : first + i - s->selected.count;
        if (!dgfem_mvci_element_is_good(mesh, e) && !dgfem_mvci_add_failed(s, e)) return DGFEM_ERROR_MEMORY;
    }
    s->elements_split = s->selected.count;
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* Notes that an element that the attempt has changed has failed: where it is not closed, or not good; one that was not
   good before may lose half of what it had. 0 when out of memory. */
static int dgfem_mvci_guard_element(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element) {
    int before = dgfem_mvci_element_before(s, element), closed;
    if (!mesh->elements[element].changed) return 1; /* then it is what it was, to the last bit */
    closed = dgfem_mvci_element_is_closed(mesh, element, &s->sides);
    if (closed < 0) return 0;
    if (closed) {
        dgfem_real height;
        if (dgfem_mvci_element_is_good(mesh, element)) return 1;
        height = dgfem_mvci_element_height(mesh, element);
        if (height > 0 && !dgfem_mvci_element_is_good(s->before, before) &&
            height >= dgfem_mvci_element_height(s->before, before) / 2)
            return 1;
    }
    return dgfem_mvci_add_failed(s, element);
}

static dgfem_status dgfem_mvci_guard_elements(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh) {
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count && !dgfem_mvci_guard_element(s, mesh, e)) return DGFEM_ERROR_MEMORY;
    return s->failed.count ? DGFEM_ERROR_DEGENERATE : DGFEM_OK;
}

/* ---- learning from a failure ---- */

/* Brings a failed element to its next stage that asks more of it. Returns 0 where there is none. */
static int dgfem_mvci_raise_element(dgfem_mvci_splitter *s, int element, int least) {
    static const dgfem_real part[DGFEM_MVCI_WHOLE] = {1, DGFEM_R(0.2), DGFEM_R(0.02), DGFEM_R(0.005), 0};
    int face_count, stage = s->stage[element], lowered = 0;
    const int *faces = dgfem_mvci_element_faces(s->before, element, &face_count);
    if (stage == DGFEM_MVCI_SEALED) return 0;
    do {
        stage++;
        for (int k = 0; k < face_count && stage < DGFEM_MVCI_WHOLE; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(s->before, faces[k] / 2, &count);
            dgfem_real limit = dgfem_mvci_max(part[stage] * s->snap, (dgfem_real)DGFEM_MVC_TIE);
            for (int j = 0; j < count; j++) {
                if (s->tolerance[loop[j]] <= limit) continue;
                s->tolerance[loop[j]] = limit;
                lowered = 1;
            }
        }
    } while (stage < least || (stage < DGFEM_MVCI_WHOLE && !lowered)); /* what changes nothing would fail again */
    s->stage[element] = (char)stage;
    return 1;
}

/* Elements that share an edge with a sealed one come to the stage, at least. 0 when out of memory. */
static int dgfem_mvci_seal_edges(dgfem_mvci_splitter *s, char stage) {
    const dgfem_mvci_mesh *mesh = s->before;
    int corners = 0;
    for (int e = 0; e < mesh->element_count; e++)
        if (s->stage[e] == DGFEM_MVCI_SEALED) corners += dgfem_mvci_element_corners(mesh, e);
    if (!corners) return 1;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->sealed, corners)) return 0;
    for (int pass = 0; pass < 2; pass++)
        for (int f = 0; f < mesh->face_count; f++) {
            int count, found = 0, sealed = 0;
            const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
            for (int side = 0; side < 2; side++)
                sealed |= owner[side] != DGFEM_NONE && s->stage[owner[side]] == DGFEM_MVCI_SEALED;
            for (int i = 0; i < count; i++) {
                int a = loop[i], b = loop[(i + 1) % count];
                if (!pass && sealed) dgfem_mvci_edges_between(&s->sealed, a, b)->value = 1;
                if (pass && !found) found = dgfem_mvci_edges_find_between(&s->sealed, a, b) != DGFEM_NONE;
            }
            for (int side = 0; side < 2 && found; side++)
                if (owner[side] != DGFEM_NONE && s->stage[owner[side]] < stage) s->stage[owner[side]] = stage;
        }
    return 1;
}

/* After a failed attempt. Returns 0 where nothing is left to be asked, which sealed elements rule out, for nothing
   changes them; negative when out of memory. So the stages rise with each attempt, and attempts come to an end; where
   they go on for long, stages are left out, and then what is sealed grows by a ring of elements each time. */
static int dgfem_mvci_splitter_learn(dgfem_mvci_splitter *s, int attempt) {
    int raised = 0;
    for (int i = 0; i < s->failed.count; i++)
        raised |= dgfem_mvci_raise_element(s, s->failed.data[i], attempt < 16 ? 0 : DGFEM_MVCI_WHOLE);
    if (attempt >= 32 && !dgfem_mvci_seal_edges(s, DGFEM_MVCI_SEALED)) return -1;
    return dgfem_mvci_seal_edges(s, DGFEM_MVCI_WHOLE) ? raised : -1;
}

/* ==== crack.c ===================================================================================================== */

/* Cuts: faces on a blade come apart.

   A blade is a plane, or a polygon in it. The elements that it meets are split along the whole plane; what lies on the
   plane, between an element above and one below, is divided along the sides of the polygon, and comes apart inside. A
   node gets as many copies as it has groups of elements that hang together around it by faces that are whole: so nodes
   inside are doubled, those on the front of the cut are not, and crossing cuts make three or four. */

typedef struct dgfem_mvci_points {
    double (*at)[2];
    int count, capacity;
} dgfem_mvci_points;

/* A polygon without corners is the whole plane. */
typedef struct dgfem_mvci_blade {
    dgfem_plane plane;         /* unit normal */
    dgfem_vec3 origin, u, v;   /* of the plane's coordinates */
    int single, element;       /* single: only this element is split */
    dgfem_mvci_points polygon; /* counter-clockwise, without crossings */
    dgfem_mvci_points hull, clip, other;
} dgfem_mvci_blade;

typedef struct dgfem_mvci_cracks {
    dgfem_mvci_ints faces;                 /* that come apart */
    dgfem_mvci_ints number;                /* [nodes] position in `nodes`, or DGFEM_NONE */
    dgfem_mvci_ints nodes;                 /* of the faces */
    dgfem_mvci_ints pair_node, root, copy; /* of (node, element) */
    dgfem_mvci_ints groups;                /* [nodes of faces] groups of elements */
    dgfem_mvci_ints region;                /* [nodes of faces] connected by faces */
    dgfem_mvci_ints cut;                   /* [faces] 1: comes apart */
    dgfem_mvci_edges pairs, surface;
    dgfem_mvci_levels levels; /* of lines in the plane */
    int nodes_copied;
} dgfem_mvci_cracks;

static void dgfem_mvci_blade_free(const dgfem_hooks *hooks, dgfem_mvci_blade *blade) {
    dgfem_mvci_free(hooks, blade->polygon.at);
    dgfem_mvci_free(hooks, blade->hull.at);
    dgfem_mvci_free(hooks, blade->clip.at);
    dgfem_mvci_free(hooks, blade->other.at);
}

static void dgfem_mvci_cracks_free(const dgfem_hooks *hooks, dgfem_mvci_cracks *c) {
    dgfem_mvci_free(hooks, c->faces.data);
    dgfem_mvci_free(hooks, c->number.data);
    dgfem_mvci_free(hooks, c->nodes.data);
    dgfem_mvci_free(hooks, c->pair_node.data);
    dgfem_mvci_free(hooks, c->root.data);
    dgfem_mvci_free(hooks, c->copy.data);
    dgfem_mvci_free(hooks, c->groups.data);
    dgfem_mvci_free(hooks, c->region.data);
    dgfem_mvci_free(hooks, c->cut.data);
    dgfem_mvci_free(hooks, c->pairs.slots);
    dgfem_mvci_free(hooks, c->surface.slots);
    dgfem_mvci_levels_free(hooks, &c->levels);
}

/* ---- in the plane ---- */

static int dgfem_mvci_points_push(const dgfem_hooks *hooks, dgfem_mvci_points *points, double x, double y) {
    void *data = points->at;
    int ok = dgfem_mvci_room(hooks, &data, points->count, &points->capacity, 1, sizeof *points->at);
    points->at = (double(*)[2])data;
    if (!ok) return 0;
    points->at[points->count][0] = x, points->at[points->count][1] = y;
    points->count++;
    return 1;
}

static void dgfem_mvci_blade_place(const dgfem_mvci_blade *blade, dgfem_vec3 x, double out[2]) {
    dgfem_vec3 d = dgfem_mvci_sub(x, blade->origin);
    out[0] = (double)dgfem_mvci_dot(d, blade->u);
    out[1] = (double)dgfem_mvci_dot(d, blade->v);
}

static double dgfem_mvci_points_area(const dgfem_mvci_points *points) {
    double area = 0;
    for (int i = 2; i < points->count; i++)
        area += dgfem_mvci_turn(points->at[0], points->at[i - 1], points->at[i]) / 2;
    return area;
}

/* Replaces points by the corners of their convex hull, counter-clockwise; `stack` is room. */
static int dgfem_mvci_points_hull(const dgfem_hooks *hooks, dgfem_mvci_points *points, dgfem_mvci_points *stack) {
    for (int i = 1; i < points->count; i++) { /* sorted by x, then y */
        double x = points->at[i][0], y = points->at[i][1];
        int j = i;
        for (; j > 0 && (points->at[j - 1][0] > x || (points->at[j - 1][0] == x && points->at[j - 1][1] > y)); j--)
            memcpy(points->at[j], points->at[j - 1], sizeof *points->at);
        points->at[j][0] = x, points->at[j][1] = y;
    }
    stack->count = 0;
    for (int pass = 0; pass < 2; pass++) {
        int base = stack->count;
        for (int k = 0; k < points->count; k++) {
            const double *p = points->at[pass ? points->count - 1 - k : k];
            while (stack->count >= base + 2 &&
                   dgfem_mvci_turn(stack->at[stack->count - 2], stack->at[stack->count - 1], p) <= 0)
                stack->count--;
            if (!dgfem_mvci_points_push(hooks, stack, p[0], p[1])) return 0;
        }
        if (stack->count) stack->count--; /* the other pass begins with it */
    }
    dgfem_mvci_points swap = *points;
    *points = *stack;
    *stack = swap;
    return 1;
}

/* Area of the blade's polygon inside blade->hull. Negative when out of memory. */
static double dgfem_mvci_overlap(const dgfem_hooks *hooks, dgfem_mvci_blade *blade) {
    blade->clip.count = 0;
    for (int i = 0; i < blade->polygon.count; i++)
        if (!dgfem_mvci_points_push(hooks, &blade->clip, blade->polygon.at[i][0], blade->polygon.at[i][1])) return -1;
    for (int k = 0; k < blade->hull.count; k++) {
        const double *a = blade->hull.at[k], *b = blade->hull.at[(k + 1) % blade->hull.count];
        blade->other.count = 0;
        for (int i = 0; i < blade->clip.count; i++) {
            const double *p = blade->clip.at[i], *q = blade->clip.at[(i + 1) % blade->clip.count];
            double dp = dgfem_mvci_turn(a, b, p), dq = dgfem_mvci_turn(a, b, q);
            if (dp >= 0 && !dgfem_mvci_points_push(hooks, &blade->other, p[0], p[1])) return -1;
            if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0)) {
                double t = dp / (dp - dq);
                if (!dgfem_mvci_points_push(hooks, &blade->other, p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
                    return -1;
            }
        }
        dgfem_mvci_points swap = blade->clip;
        blade->clip = blade->other;
        blade->other = swap;
    }
    return fabs(dgfem_mvci_points_area(&blade->clip));
}

static int dgfem_mvci_inside(const dgfem_mvci_points *polygon, const double *p) {
    int inside = 0;
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->at[i], *b = polygon->at[(i + 1) % polygon->count];
        if ((a[1] > p[1]) == (b[1] > p[1])) continue;
        if (p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])) inside = !inside;
    }
    return inside;
}

/* Distance of a point from the sides of a polygon. */
static double dgfem_mvci_side_distance(const dgfem_mvci_points *polygon, const double *p) {
    double least = HUGE_VAL;
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->at[i], *b = polygon->at[(i + 1) % polygon->count];
        double square = dgfem_mvci_square(a, b), q[2];
        double t = square > 0 ? ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / square : 0;
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        for (int k = 0; k < 2; k++) q[k] = a[k] + t * (b[k] - a[k]);
        double distance = sqrt(dgfem_mvci_square(p, q));
        if (distance < least) least = distance;
    }
    return least;
}

/* ---- which elements a blade meets ---- */

/* The blade's plane in an element, from the crossings of its edges, becomes blade->hull. */
static int dgfem_mvci_section(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int element,
                              dgfem_mvci_blade *blade) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    int face_count;
    const int *faces = dgfem_mvci_element_faces(mesh, element, &face_count);
    blade->hull.count = 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            int a = loop[i], b = loop[(i + 1) % count];
            dgfem_real va = s->levels.value[a], vb = s->levels.value[b];
            double p[2];
            if (!(va == 0 || (va > 0 && vb < 0) || (va < 0 && vb > 0))) continue;
            dgfem_real t = va == 0 ? 0 : va / (va - vb);
            dgfem_mvci_blade_place(blade, dgfem_mvci_axpy(x[a], t, dgfem_mvci_sub(x[b], x[a])), p);
            if (!dgfem_mvci_points_push(s->hooks, &blade->hull, p[0], p[1])) return 0;
        }
    }
    return dgfem_mvci_points_hull(s->hooks, &blade->hull, &blade->other);
}

/* Smaller parts of an area are taken for none. */
static double dgfem_mvci_least_area(void) { return DGFEM_REAL_IS_FLOAT ? 1e-4 : 1e-6; }

/* Levels of all nodes; s->selected: elements that the blade passes; s->elements_kept: others that it passes but that
   have to stay whole. 0 when out of memory. */
static int dgfem_mvci_select(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade) {
    s->selected.count = s->elements_kept = 0;
    if (!dgfem_mvci_measure_levels(s, mesh)) return 0;
    for (int e = 0; e < mesh->element_count; e++) {
        if (blade->single && e != blade->element) continue;
        if (!dgfem_mvci_element_straddles(mesh, e, &s->levels)) continue;
        if (blade->polygon.count) {
            if (!dgfem_mvci_section(s, mesh, e, blade)) return 0;
            double whole = dgfem_mvci_points_area(&blade->hull), part = dgfem_mvci_overlap(s->hooks, blade);
            if (part < 0) return 0;
            if (!(part > dgfem_mvci_least_area() * whole)) continue;
        }
        if (dgfem_mvci_stays_whole(s, e)) s->elements_kept++;
        else if (!dgfem_mvci_push(s->hooks, &s->selected, e)) return 0;
    }
    return 1;
}

/* ---- faces on the blade ---- */

/* Which side of the blade the element of a face on the blade is on (1 above, -1 below). One that is on both, elsewhere,
   is on the side that the face looks away from; 0 where the face does not lie along the blade. */
static int dgfem_mvci_element_side(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face, int side) {
    int face_count, above = 0, below = 0, count;
    const int *faces = dgfem_mvci_element_faces(mesh, mesh->faces[face].owner[side], &face_count);
    dgfem_real sum = 0;
    for (int k = 0; k < face_count; k++) {
        const int *loop = dgfem_mvci_face_loop(mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            above |= s->levels.sign[loop[i]] > 0, below |= s->levels.sign[loop[i]] < 0;
            sum += s->levels.value[loop[i]];
        }
    }
    if (above != below) return above - below;
    if (!above) return sum > 0 ? 1 : -1; /* flat on the blade */
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(dgfem_mvci_blade_space(s, mesh), loop, count));
    dgfem_real up = dgfem_mvci_dot(normal, s->plane.normal);
    if (dgfem_mvci_abs(up) < DGFEM_R(0.5)) return 0;
    return (up > 0) == !side ? -1 : 1;
}

/* c->faces: those between an element above and one below. 0 when out of memory. */
static int dgfem_mvci_find_blade_faces(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                       dgfem_mvci_cracks *c) {
    c->faces.count = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int count, on = 1;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
        if (owner[0] == DGFEM_NONE || owner[1] == DGFEM_NONE) continue;
        for (int i = 0; i < count && on; i++) on = s->levels.sign[loop[i]] == 0;
        if (!on) continue;
        if (dgfem_mvci_element_side(s, mesh, f, 0) * dgfem_mvci_element_side(s, mesh, f, 1) >= 0) continue;
        if (!dgfem_mvci_push(s->hooks, &c->faces, f)) return 0;
    }
    return 1;
}

/* Length of the part of a segment that lies in a convex face, relative to the face. */
static double dgfem_mvci_segment_in_face(const dgfem_mvci_blade *blade, const dgfem_vec3 *x, const int *loop, int count,
                                         const double *a, const double *b) {
    double low = 0, high = 1, area = 0, size = 0, p[2], q[2], start[2];
    dgfem_mvci_blade_place(blade, x[loop[0]], start);
    for (int i = 0; i < count; i++) {
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        dgfem_mvci_blade_place(blade, x[loop[(i + 1) % count]], q);
        area += dgfem_mvci_turn(start, p, q);
        size += sqrt(dgfem_mvci_square(p, q));
    }
    for (int i = 0; i < count; i++) {
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        dgfem_mvci_blade_place(blade, x[loop[(i + 1) % count]], q);
        double da = dgfem_mvci_turn(p, q, a), db = dgfem_mvci_turn(p, q, b);
        double length = sqrt(dgfem_mvci_square(p, q)), none = 1e-9 * size * length;
        if (area < 0) da = -da, db = -db;
        if (da <= none && db <= none) return 0;
        if (da < 0 && db > 0 && da / (da - db) > low) low = da / (da - db);
        if (da > 0 && db < 0 && da / (da - db) < high) high = da / (da - db);
    }
    return high > low ? (high - low) * sqrt(dgfem_mvci_square(a, b)) / size : 0;
}

/* Distances from the line through a and b, positive on its left, of the nodes of a face. */
static int dgfem_mvci_line_levels(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                  const dgfem_mvci_blade *blade, dgfem_mvci_cracks *c, int face, const double *a,
                                  const double *b) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    int count;
    const int *loop = dgfem_mvci_face_loop(mesh, face, &count);
    double length = sqrt(dgfem_mvci_square(a, b));
    if (!dgfem_mvci_levels_room(s->hooks, &c->levels, mesh->node_count)) return 0;
    for (int i = 0; i < count; i++) {
        double p[2], distance;
        dgfem_mvci_blade_place(blade, x[loop[i]], p);
        distance = dgfem_mvci_turn(a, b, p) / length;
        if (fabs(distance) <= 64 * (double)DGFEM_MVC_EPSILON * (fabs(p[0]) + fabs(p[1]) + length)) distance = 0;
        c->levels.value[loop[i]] = (dgfem_real)distance;
        c->levels.sign[loop[i]] = (signed char)dgfem_mvci_sign((dgfem_real)distance);
    }
    return 1;
}

/* Divides the faces of c->faces that a side of the polygon crosses, by its whole line; the new parts are appended. 0
   when out of memory. */
static int dgfem_mvci_divide_along(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                   dgfem_mvci_cracks *c, const double *a, const double *b) {
    int before = c->faces.count, corners = 0;
    s->list.count = 0;
    for (int k = 0; k < before; k++) {
        int f = c->faces.data[k], count, keep = 0;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count);
        for (int side = 0; side < 2; side++) keep |= dgfem_mvci_stays_whole(s, mesh->faces[f].owner[side]);
        if (keep || !(dgfem_mvci_segment_in_face(blade, dgfem_mvci_blade_space(s, mesh), loop, count, a, b) > 1e-6))
            continue;
        corners += count;
        if (!dgfem_mvci_push(s->hooks, &s->list, f) || !dgfem_mvci_line_levels(s, mesh, blade, c, f, a, b)) return 0;
    }
    for (int k = 0; k < s->list.count; k++) dgfem_mvci_snap_face(s, mesh, s->list.data[k], &c->levels);
    for (int changed = 1; changed;) {
        changed = 0;
        for (int k = 0; k < s->list.count; k++)
            changed |= dgfem_mvci_snap_between(s, mesh, s->list.data[k], &c->levels);
    }
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return 0;
    for (int k = 0; k < s->list.count; k++)
        if (dgfem_mvci_face_changes(mesh, s->list.data[k], &c->levels) == 2 &&
            !dgfem_mvci_cross_face(s, mesh, &c->levels, s->list.data[k]))
            return 0;
    if (!dgfem_mvci_insert_nodes(s, mesh)) return 0;
    for (int k = 0; k < s->list.count; k++) {
        if (dgfem_mvci_face_changes(mesh, s->list.data[k], &c->levels) != 2) continue;
        int part = dgfem_mvci_split_face(s, mesh, s->list.data[k], &c->levels);
        if (part == DGFEM_NONE) return 0;
        if (part != s->list.data[k] && !dgfem_mvci_push(s->hooks, &c->faces, part)) return 0;
    }
    return dgfem_mvci_levels_room(s->hooks, &s->levels, mesh->node_count);
}

static double dgfem_mvci_longest_edge(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                      const dgfem_mvci_cracks *c) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    double longest = 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        for (int i = 0; i < count; i++)
            longest = fmax(longest, (double)dgfem_mvci_distance(x[loop[i]], x[loop[(i + 1) % count]]));
    }
    return longest;
}

/* Keeps in c->faces what lies inside of the polygon, or so little outside that snapping may have put it there: else
   polygons with a side in common would leave slivers whole between them. */
static void dgfem_mvci_keep_inside(const dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh,
                                   const dgfem_mvci_blade *blade, dgfem_mvci_cracks *c) {
    const dgfem_vec3 *x = dgfem_mvci_blade_space(s, mesh);
    double near = (double)s->snap / 2 * dgfem_mvci_longest_edge(s, mesh, c);
    int kept = 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        double start[2], p[2], q[2], centre[2] = {0, 0}, area = 0;
        dgfem_mvci_blade_place(blade, x[loop[0]], start);
        for (int i = 2; i < count; i++) {
            dgfem_mvci_blade_place(blade, x[loop[i - 1]], p);
            dgfem_mvci_blade_place(blade, x[loop[i]], q);
            double part = dgfem_mvci_turn(start, p, q);
            area += part;
            for (int j = 0; j < 2; j++) centre[j] += part * (p[j] + q[j] - 2 * start[j]) / 3;
        }
        if (area == 0) continue;
        for (int j = 0; j < 2; j++) centre[j] = start[j] + centre[j] / area;
        if (dgfem_mvci_inside(&blade->polygon, centre) || dgfem_mvci_side_distance(&blade->polygon, centre) <= near)
            c->faces.data[kept++] = c->faces.data[k];
    }
    c->faces.count = kept;
}

/* ---- what hangs together around a node ---- */

/* Fills `ints` with `count` times `value`. 0 when out of memory. */
static int dgfem_mvci_fill(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int count, int value) {
    ints->count = 0;
    if (!dgfem_mvci_ints_room(hooks, ints, count)) return 0;
    while (ints->count < count) ints->data[ints->count++] = value;
    return 1;
}

/* The nodes of c->faces, and their regions. 0 when out of memory. */
static int dgfem_mvci_number_crack(const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    c->nodes.count = c->region.count = 0;
    if (!dgfem_mvci_fill(hooks, &c->number, mesh->node_count, DGFEM_NONE) ||
        !dgfem_mvci_fill(hooks, &c->cut, mesh->face_count, 0))
        return 0;
    for (int k = 0; k < c->faces.count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
        c->cut.data[c->faces.data[k]] = 1;
        for (int i = 0; i < count; i++) {
            if (c->number.data[loop[i]] == DGFEM_NONE) {
                c->number.data[loop[i]] = c->nodes.count;
                if (!dgfem_mvci_push(hooks, &c->region, c->nodes.count) || !dgfem_mvci_push(hooks, &c->nodes, loop[i]))
                    return 0;
            }
            if (i) dgfem_mvci_join(c->region.data, c->number.data[loop[0]], c->number.data[loop[i]]);
        }
    }
    return 1;
}

/* The (node, element) of a node of the crack; made where it is not there. DGFEM_NONE when out of memory. */
static int dgfem_mvci_pair(const dgfem_hooks *hooks, dgfem_mvci_cracks *c, int node, int element) {
    dgfem_mvci_edge *pair = dgfem_mvci_edges_at(&c->pairs, node, element);
    if (pair->value != DGFEM_NONE) return pair->value;
    if (!dgfem_mvci_push(hooks, &c->pair_node, node) || !dgfem_mvci_push(hooks, &c->root, c->root.count))
        return DGFEM_NONE;
    return pair->value = c->root.count - 1;
}

/* c->groups: number of groups of elements at each node of the crack; c->surface: edges of the boundary between such
   nodes. 0 when out of memory. */
static int dgfem_mvci_group_elements(const dgfem_hooks *hooks, const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int uses = 0;
    c->pair_node.count = c->root.count = 0;
    for (int f = 0; f < mesh->face_count; f++)
        for (int i = 0; i < mesh->faces[f].count && mesh->faces[f].owner[0] != DGFEM_NONE; i++)
            uses += c->number.data[mesh->loops.data[mesh->faces[f].loop + i]] != DGFEM_NONE;
    if (!dgfem_mvci_edges_reset(hooks, &c->pairs, 2 * uses) || !dgfem_mvci_edges_reset(hooks, &c->surface, uses) ||
        !dgfem_mvci_fill(hooks, &c->groups, c->nodes.count, 0))
        return 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(mesh, f, &count), *owner = mesh->faces[f].owner;
        for (int i = 0; i < count && owner[0] != DGFEM_NONE; i++) {
            int next = loop[(i + 1) % count];
            if (c->number.data[loop[i]] == DGFEM_NONE) continue;
            int a = dgfem_mvci_pair(hooks, c, loop[i], owner[0]), b = a;
            if (owner[1] != DGFEM_NONE) b = dgfem_mvci_pair(hooks, c, loop[i], owner[1]);
            if (a == DGFEM_NONE || b == DGFEM_NONE) return 0;
            if (!c->cut.data[f]) dgfem_mvci_join(c->root.data, a, b);
            if (owner[1] == DGFEM_NONE && c->number.data[next] != DGFEM_NONE)
                dgfem_mvci_edges_between(&c->surface, loop[i], next)->value = 1;
        }
    }
    for (int p = 0; p < c->root.count; p++)
        if (c->root.data[p] == p) c->groups.data[c->number.data[c->pair_node.data[p]]]++;
    return 1;
}

/* ---- cuts that could not open ---- */

/* Nodes in the middle of edges at which a cut meets the surface, where both ends hang together. Returns their number,
   -1 when out of memory. */
static int dgfem_mvci_open_mouths(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int corners = 0, made = 0;
    for (int k = 0; k < c->faces.count; k++) corners += mesh->faces[c->faces.data[k]].count;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->crossings, corners)) return -1;
    for (int k = 0; k < c->faces.count; k++)
        for (int i = 0; i < mesh->faces[c->faces.data[k]].count; i++) {
            const dgfem_mvci_face *face = &mesh->faces[c->faces.data[k]];
            int a = mesh->loops.data[face->loop + i], b = mesh->loops.data[face->loop + (i + 1) % face->count];
            if (c->groups.data[c->number.data[a]] > 1 || c->groups.data[c->number.data[b]] > 1) continue;
            if (dgfem_mvci_edges_find_between(&c->surface, a, b) == DGFEM_NONE) continue;
            if (dgfem_mvci_edge_is_sealed(s, a, b)) continue;
            dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->crossings, a, b);
            if (edge->value != DGFEM_NONE) continue;
            edge->value = dgfem_mvci_add_node_between(mesh, edge->a, edge->b, DGFEM_R(0.5));
            if (edge->value == DGFEM_NONE) return -1;
            made++;
        }
    if (made && !dgfem_mvci_insert_nodes(s, mesh)) return -1;
    s->nodes_added += made;
    return made;
}

/* The triangle of a face that has its centroid, and the centroid's coordinates in it. */
static void dgfem_mvci_face_centre(const dgfem_mvci_mesh *mesh, int face, int nodes[3], dgfem_real weights[3]) {
    int count, best = 0;
    const int *triangles = dgfem_mvci_face_triangles(mesh, face, &count);
    dgfem_vec3 normal =
        dgfem_mvci_loop_area(mesh->rest, mesh->loops.data + mesh->faces[face].loop, mesh->faces[face].count);
    dgfem_vec3 centre = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real total = 0, best_least = 0;
    for (int t = 0; t < count; t++) {
        dgfem_real area = dgfem_mvci_dot(dgfem_mvci_loop_area(mesh->rest, triangles + 3 * t, 3), normal);
        total += area;
        for (int i = 0; i < 3; i++) centre = dgfem_mvci_axpy(centre, area / 3, mesh->rest[triangles[3 * t + i]]);
    }
    centre = dgfem_mvci_scale(1 / total, centre);
    for (int t = 0; t < count; t++) {
        dgfem_real w[3], sum = 0, least;
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 a = dgfem_mvci_sub(mesh->rest[triangles[3 * t + (i + 1) % 3]], centre);
            dgfem_vec3 b = dgfem_mvci_sub(mesh->rest[triangles[3 * t + (i + 2) % 3]], centre);
            sum += w[i] = dgfem_mvci_dot(dgfem_mvci_cross(a, b), normal);
        }
        least = (w[0] < w[1] ? w[0] : w[1]) / sum;
        if (w[2] / sum < least) least = w[2] / sum;
        if (t && least <= best_least) continue;
        best = t, best_least = least;
        for (int i = 0; i < 3; i++) weights[i] = w[i] / sum;
    }
    for (int i = 0; i < 3; i++) nodes[i] = triangles[3 * best + i];
}

/* A node at the centroid of a face, which is divided into triangles around it, all cut. 0 when out of memory. */
static int dgfem_mvci_fan(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c, int face) {
    dgfem_mvci_face old = mesh->faces[face];
    int nodes[3], loop[3];
    dgfem_real weights[3];
    dgfem_mvci_face_centre(mesh, face, nodes, weights);
    int centre = dgfem_mvci_add_node(mesh, nodes, weights, 3);
    if (centre == DGFEM_NONE) return 0;
    s->nodes_added++;
    s->buffer.count = 0;
    if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + old.loop, old.count) == DGFEM_NONE) return 0;
    for (int i = 0; i < old.count; i++) {
        loop[0] = centre, loop[1] = s->buffer.data[i], loop[2] = s->buffer.data[(i + 1) % old.count];
        if (!i) {
            if (!dgfem_mvci_set_loop(mesh, face, loop, 3)) return 0;
            continue;
        }
        int index = dgfem_mvci_add_face(mesh, old.owner[0], old.owner[1], loop, 3, old.from, old.wall);
        if (index == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &c->faces, index)) return 0;
        for (int side = 0; side < 2; side++)
            if (!dgfem_mvci_add_element_face(mesh, old.owner[side], index, side)) return 0;
    }
    return 1;
}

/* Takes the first `faces` of c->faces that are in a region from the list. Returns how many of the first remain. */
static int dgfem_mvci_leave_region(const dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c, int region, int faces) {
    int kept = 0, left = faces;
    for (int k = 0; k < c->faces.count; k++) {
        int first = mesh->loops.data[mesh->faces[c->faces.data[k]].loop];
        if (k < faces && first < c->number.count && dgfem_mvci_root(c->region.data, c->number.data[first]) == region)
            left--;
        else c->faces.data[kept++] = c->faces.data[k];
    }
    c->faces.count = kept;
    return left;
}

/* In each region none of whose nodes has two groups, a node in the largest face that no sealed element has; a region
   without such a face does not come apart. Returns the number of nodes, -1 when out of memory. */
static int dgfem_mvci_open_pockets(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int made = 0, faces = c->faces.count;
    for (int n = 0; n < c->nodes.count; n++) {
        int open = 0, best = DGFEM_NONE;
        dgfem_real largest = 0;
        if (dgfem_mvci_root(c->region.data, n) != n) continue;
        for (int i = n; i < c->nodes.count && !open; i++)
            open = dgfem_mvci_root(c->region.data, i) == n && c->groups.data[i] > 1;
        for (int k = 0; k < faces && !open; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(mesh, c->faces.data[k], &count);
            /* after a fan, its face is no longer of that region's old nodes alone: the fan's node has no number */
            if (loop[0] >= c->number.count || dgfem_mvci_root(c->region.data, c->number.data[loop[0]]) != n) continue;
            const int *owner = mesh->faces[c->faces.data[k]].owner;
            if (dgfem_mvci_is_sealed(s, owner[0]) || dgfem_mvci_is_sealed(s, owner[1])) continue;
            dgfem_real area = dgfem_mvci_norm(dgfem_mvci_loop_area(mesh->rest, loop, count));
            if (area > largest) largest = area, best = c->faces.data[k];
        }
        if (!open && best == DGFEM_NONE) faces = dgfem_mvci_leave_region(mesh, c, n, faces);
        if (best == DGFEM_NONE) continue;
        if (!dgfem_mvci_fan(s, mesh, c, best)) return -1;
        made++;
    }
    return made;
}

/* ---- coming apart ---- */

static void dgfem_mvci_rename(const dgfem_mvci_cracks *c, int element, int *nodes, int count) {
    for (int i = 0; i < count; i++) {
        if (nodes[i] >= c->number.count || c->number.data[nodes[i]] == DGFEM_NONE) continue;
        int pair = dgfem_mvci_edges_find(&c->pairs, nodes[i], element);
        nodes[i] = c->copy.data[c->root.data[pair]];
    }
}

static void dgfem_mvci_reverse(int *nodes, int count) {
    for (int i = 0, j = count - 1; i < j; i++, j--) {
        int swap = nodes[i];
        nodes[i] = nodes[j], nodes[j] = swap;
    }
}

/* The side of owner[1] becomes a face of its own. Its triangles keep their order, and the loop its start, so that
   nothing measured differs by round-off from what it was for owner[1] before. 0 when out of memory. */
static int dgfem_mvci_part_face(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, const dgfem_mvci_cracks *c, int face) {
    dgfem_mvci_face old = mesh->faces[face];
    s->buffer.count = 0;
    if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + old.loop, old.count) == DGFEM_NONE ||
        dgfem_mvci_append(s->hooks, &s->buffer, mesh->triangles.data + old.triangle, 3 * old.triangle_count) ==
            DGFEM_NONE)
        return 0;
    dgfem_mvci_rename(c, old.owner[1], s->buffer.data, s->buffer.count);
    dgfem_mvci_reverse(s->buffer.data + 1, old.count - 1);
    for (int t = 0; t < old.triangle_count; t++) dgfem_mvci_reverse(s->buffer.data + old.count + 3 * t + 1, 2);
    int other = dgfem_mvci_add_face(mesh, old.owner[1], DGFEM_NONE, s->buffer.data, old.count, DGFEM_NONE, 1);
    if (other == DGFEM_NONE) return 0;
    int start = dgfem_mvci_append(s->hooks, &mesh->triangles, s->buffer.data + old.count, 3 * old.triangle_count);
    if (start == DGFEM_NONE) return 0;
    mesh->faces[other].triangle = start;
    mesh->faces[other].triangle_count = old.triangle_count;
    mesh->faces[face].owner[1] = DGFEM_NONE;
    mesh->faces[face].wall = 1;
    dgfem_mvci_element *element = &mesh->elements[old.owner[1]];
    for (int k = 0; k < element->face_count; k++)
        if (mesh->element_faces.data[element->face + k] == 2 * face + 1)
            mesh->element_faces.data[element->face + k] = 2 * other;
    return 1;
}

/* Copies nodes and doubles faces. 0 when out of memory. */
static int dgfem_mvci_part(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_cracks *c) {
    int faces = mesh->face_count;
    c->nodes_copied = 0;
    if (!dgfem_mvci_fill(s->hooks, &c->copy, c->root.count, DGFEM_NONE)) return 0;
    for (int p = 0; p < c->root.count; p++) {
        int node = c->pair_node.data[p], root = dgfem_mvci_root(c->root.data, p);
        c->root.data[p] = root;
        if (root != p) continue;
        if (c->groups.data[c->number.data[node]] > 0) { /* the first group keeps the node */
            c->groups.data[c->number.data[node]] = 0;
            c->copy.data[p] = node;
            continue;
        }
        c->copy.data[p] = dgfem_mvci_copy_node(mesh, node);
        if (c->copy.data[p] == DGFEM_NONE) return 0;
        c->nodes_copied++;
    }
    for (int k = 0; k < c->faces.count; k++)
        if (!dgfem_mvci_part_face(s, mesh, c, c->faces.data[k])) return 0;
    for (int f = 0; f < faces; f++) {
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] == DGFEM_NONE) continue;
        dgfem_mvci_rename(c, face->owner[0], mesh->loops.data + face->loop, face->count);
        dgfem_mvci_rename(c, face->owner[0], mesh->triangles.data + face->triangle, 3 * face->triangle_count);
    }
    return 1;
}

/* ---- one attempt ---- */

/* Elements of a face that are no longer good have failed. */
static dgfem_status dgfem_mvci_check_owners(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, int face) {
    for (int side = 0; side < 2; side++) {
        int owner = mesh->faces[face].owner[side];
        if (!dgfem_mvci_guard_element(s, mesh, owner)) return DGFEM_ERROR_MEMORY;
    }
    return DGFEM_OK;
}

/* Splits the elements that a blade passes and, where `open`, parts the faces on it; c->faces: those. Marks the elements
   that the attempt, not those before, has changed. The mesh is spoilt where it fails. DGFEM_ERROR_DEGENERATE: at
   s->failed. */
static dgfem_status dgfem_mvci_cut_attempt(dgfem_mvci_splitter *s, dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                           int open, dgfem_mvci_cracks *c) {
    c->faces.count = 0;
    c->nodes_copied = 0;
    c->levels.count = 0;
    for (int e = 0; e < mesh->element_count; e++) mesh->elements[e].changed = 0;
    if (!dgfem_mvci_select(s, mesh, blade)) return DGFEM_ERROR_MEMORY;
    dgfem_status status = dgfem_mvci_split_selected(s, mesh);
    if (!status && !open) status = dgfem_mvci_guard_elements(s, mesh);
    if (status || !open) return status;

    if (!dgfem_mvci_find_blade_faces(s, mesh, c)) return DGFEM_ERROR_MEMORY;
    if (blade->polygon.count) {
        for (int i = 0; i < blade->polygon.count; i++)
            if (!dgfem_mvci_divide_along(s, mesh, blade, c, blade->polygon.at[i],
                                         blade->polygon.at[(i + 1) % blade->polygon.count]))
                return DGFEM_ERROR_MEMORY;
        status = dgfem_mvci_settle_attempt(s, mesh);
        for (int k = 0; !status && k < c->faces.count; k++) status = dgfem_mvci_check_owners(s, mesh, c->faces.data[k]);
        if (!status && s->failed.count) status = DGFEM_ERROR_DEGENERATE;
        if (status) return status;
        dgfem_mvci_keep_inside(s, mesh, blade, c);
    }
    for (int round = 0; round < 3 && c->faces.count; round++) {
        if (!dgfem_mvci_number_crack(s->hooks, mesh, c) || !dgfem_mvci_group_elements(s->hooks, mesh, c))
            return DGFEM_ERROR_MEMORY;
        int made = round ? 0 : dgfem_mvci_open_mouths(s, mesh, c);
        if (!made && round < 2) made = dgfem_mvci_open_pockets(s, mesh, c);
        if (made < 0) return DGFEM_ERROR_MEMORY;
        if (!made) break;
        status = dgfem_mvci_settle_attempt(s, mesh);
        if (status) return status;
    }
    status = dgfem_mvci_guard_elements(s, mesh); /* neighbours have got nodes, too */
    if (!status && c->faces.count && !dgfem_mvci_part(s, mesh, c)) status = DGFEM_ERROR_MEMORY;
    return status;
}

/* ==== sliver.c ==================================================================================================== */

/* Removing flat elements and needles.

   A flat element is pressed into a plane: nodes that meet there become one, its edges are cut where they cross, and the
   cells of the plane become the faces between what was above it and what was below:

        above    above                above
       /-------------\
      <  flat element >   ->    ------x-------x-----
       \-----x-------/
         below  below             below   below

   A needle's short edges vanish, and with them the needle; flat neighbours that come of this follow. Nodes of the
   body's boundary move within the boundary only. Each removal is tried on a copy, and dropped where the elements around
   are not good afterwards, or where volume has passed the boundary. */

typedef struct dgfem_mvci_sliver {
    const dgfem_hooks *hooks;
    dgfem_mvci_mesh *mesh; /* the copy */
    dgfem_vec3 origin, u, v, n;
    dgfem_real diameter;
    dgfem_mvci_ints nodes;    /* of the element */
    dgfem_mvci_ints near;     /* faces with such nodes */
    dgfem_mvci_ints affected; /* elements of those */
    dgfem_mvci_ints queue;    /* elements to be removed */
    dgfem_mvci_ints root;     /* [nodes] welded to */
    dgfem_mvci_ints rank;     /* [nodes] independent directions in which a node may not move */
    dgfem_mvci_ints ends;     /* pairs of nodes: edges of the element */
    dgfem_mvci_ints cell, mark, buffer, list;
    dgfem_mvci_edges edges;
    dgfem_mvci_polygon polygon;
} dgfem_mvci_sliver;

static void dgfem_mvci_sliver_free(dgfem_mvci_sliver *s) {
    dgfem_mvci_free(s->hooks, s->nodes.data);
    dgfem_mvci_free(s->hooks, s->near.data);
    dgfem_mvci_free(s->hooks, s->affected.data);
    dgfem_mvci_free(s->hooks, s->queue.data);
    dgfem_mvci_free(s->hooks, s->root.data);
    dgfem_mvci_free(s->hooks, s->rank.data);
    dgfem_mvci_free(s->hooks, s->ends.data);
    dgfem_mvci_free(s->hooks, s->cell.data);
    dgfem_mvci_free(s->hooks, s->mark.data);
    dgfem_mvci_free(s->hooks, s->buffer.data);
    dgfem_mvci_free(s->hooks, s->list.data);
    dgfem_mvci_free(s->hooks, s->edges.slots);
    dgfem_mvci_polygon_free(s->hooks, &s->polygon);
}

/* Results of the steps below. */
enum { DGFEM_MVCI_NO_MEMORY = -1, DGFEM_MVCI_REFUSED = 0, DGFEM_MVCI_DONE = 1 };

static int dgfem_mvci_push_once(const dgfem_hooks *hooks, dgfem_mvci_ints *ints, int value) {
    for (int i = 0; i < ints->count; i++)
        if (ints->data[i] == value) return 1;
    return dgfem_mvci_push(hooks, ints, value);
}

static int dgfem_mvci_position_in(const dgfem_mvci_ints *ints, int value) {
    for (int i = 0; i < ints->count; i++)
        if (ints->data[i] == value) return i;
    return DGFEM_NONE;
}

/* ---- the neighbourhood ---- */

static int dgfem_mvci_sliver_nodes(dgfem_mvci_sliver *s, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    s->nodes.count = 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++)
            if (!dgfem_mvci_push_once(s->hooks, &s->nodes, loop[i])) return 0;
    }
    return 1;
}

/* Faces that have a node of s->nodes; s->affected gains their elements. */
static int dgfem_mvci_sliver_near(dgfem_mvci_sliver *s) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    if (!dgfem_mvci_fill(s->hooks, &s->mark, mesh->node_count, 0)) return 0;
    for (int i = 0; i < s->nodes.count; i++) s->mark.data[s->nodes.data[i]] = 1;
    s->near.count = 0;
    for (int f = 0; f < mesh->face_count; f++) {
        int found = 0;
        const dgfem_mvci_face *face = &mesh->faces[f];
        if (face->owner[0] == DGFEM_NONE) continue;
        for (int i = 0; i < face->count && !found; i++) found = s->mark.data[mesh->loops.data[face->loop + i]];
        if (!found) continue;
        if (!dgfem_mvci_push(s->hooks, &s->near, f)) return 0;
        for (int side = 0; side < 2; side++)
            if (face->owner[side] != DGFEM_NONE && !dgfem_mvci_push_once(s->hooks, &s->affected, face->owner[side]))
                return 0;
    }
    return 1;
}

/* Volume and its first moment of the affected elements. */
static dgfem_real dgfem_mvci_affected_volume(const dgfem_mvci_sliver *s, const dgfem_mvci_mesh *mesh,
                                             dgfem_vec3 *moment) {
    dgfem_real sum = 0;
    *moment = dgfem_mvci_vec3(0, 0, 0);
    for (int i = 0; i < s->affected.count; i++) {
        dgfem_vec3 centre;
        if (!mesh->elements[s->affected.data[i]].face_count) continue;
        dgfem_real volume = dgfem_mvci_element_measure(mesh, s->affected.data[i], &centre);
        sum += volume;
        *moment = dgfem_mvci_axpy(*moment, volume, dgfem_mvci_sub(centre, s->origin));
    }
    return sum;
}

/* The directions in which the boundary does not let a node move: at most three, orthonormal. */
static int dgfem_mvci_node_bounds(const dgfem_mvci_sliver *s, int node, dgfem_vec3 bounds[3]) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    int rank = 0;
    for (int k = 0; k < s->near.count && rank < 3; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        const int *loop = mesh->loops.data + face->loop;
        int found = 0;
        if (face->owner[0] == DGFEM_NONE || face->owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < face->count && !found; i++) found = loop[i] == node;
        if (!found) continue;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(mesh->rest, loop, face->count));
        for (int i = 0; i < rank; i++) normal = dgfem_mvci_axpy(normal, -dgfem_mvci_dot(normal, bounds[i]), bounds[i]);
        if (dgfem_mvci_norm(normal) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-7)))
            bounds[rank++] = dgfem_mvci_unit(normal);
    }
    return rank;
}

/* Mean, and principal axes and extents, of the element's nodes. */
static void dgfem_mvci_sliver_axes(dgfem_mvci_sliver *s, dgfem_real extent[3]) {
    dgfem_mat3 a, axes;
    dgfem_real values[3];
    dgfem_vec3 axis[3], mean = dgfem_mvci_vec3(0, 0, 0);
    memset(&a, 0, sizeof a);
    for (int i = 0; i < s->nodes.count; i++)
        mean = dgfem_mvci_axpy(mean, 1 / (dgfem_real)s->nodes.count, s->mesh->rest[s->nodes.data[i]]);
    for (int i = 0; i < s->nodes.count; i++) {
        dgfem_vec3 d = dgfem_mvci_sub(s->mesh->rest[s->nodes.data[i]], mean);
        dgfem_mvci_add_outer(&a, 1, d, d);
    }
    dgfem_eigen_symmetric(a, values, &axes);
    for (int k = 0; k < 3; k++) {
        dgfem_real low = 0, high = 0;
        axis[k] = dgfem_mvci_vec3(axes.m[0][k], axes.m[1][k], axes.m[2][k]);
        for (int i = 0; i < s->nodes.count; i++) {
            dgfem_real x = dgfem_mvci_dot(axis[k], dgfem_mvci_sub(s->mesh->rest[s->nodes.data[i]], mean));
            if (x < low) low = x;
            if (x > high) high = x;
        }
        extent[k] = high - low;
    }
    s->origin = mean;
    s->n = axis[0], s->u = axis[1], s->v = dgfem_mvci_cross(s->n, s->u);
    s->diameter = extent[2];
}

static void dgfem_mvci_sliver_place(const dgfem_mvci_sliver *s, int node, double out[2]) {
    dgfem_vec3 d = dgfem_mvci_sub(s->mesh->rest[node], s->origin);
    out[0] = (double)dgfem_mvci_dot(d, s->u);
    out[1] = (double)dgfem_mvci_dot(d, s->v);
}

/* Area of a face projected along s->n, signed as seen from outside of the element. */
static dgfem_real dgfem_mvci_projected_area(const dgfem_mvci_sliver *s, int entry) {
    int count;
    const int *loop = dgfem_mvci_face_loop(s->mesh, entry / 2, &count);
    dgfem_real area = dgfem_mvci_dot(dgfem_mvci_loop_area(s->mesh->rest, loop, count), s->n) / 2;
    return entry & 1 ? -area : area;
}

/* ---- moving nodes ---- */

/* The mean gradient of the deformation around a node, from all nodes of the faces near it. */
static dgfem_mat3 dgfem_mvci_local_gradient(const dgfem_mvci_sliver *s, int node) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    dgfem_mat3 a, b, inverse;
    memset(&a, 0, sizeof a);
    memset(&b, 0, sizeof b);
    for (int k = 0; k < s->near.count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        for (int i = 0; i < face->count && face->owner[0] != DGFEM_NONE; i++) {
            int other = mesh->loops.data[face->loop + i];
            dgfem_vec3 d = dgfem_mvci_sub(mesh->rest[other], mesh->rest[node]);
            dgfem_mvci_add_outer(&a, 1, d, d);
            dgfem_mvci_add_outer(&b, 1, dgfem_mvci_sub(mesh->position[other], mesh->position[node]), d);
        }
    }
    if (!dgfem_mvci_invert(&a, &inverse)) return dgfem_mvci_identity();
    return dgfem_mvci_multiply3(&b, &inverse);
}

static void dgfem_mvci_move_node(dgfem_mvci_sliver *s, int node, dgfem_vec3 by) {
    dgfem_mat3 gradient = dgfem_mvci_local_gradient(s, node);
    s->mesh->rest[node] = dgfem_mvci_add(s->mesh->rest[node], by);
    s->mesh->position[node] = dgfem_mvci_add(s->mesh->position[node], dgfem_mvci_multiply(&gradient, by));
}

/* Moves a node into the plane, as far as the boundary lets it. */
static void dgfem_mvci_press_node(dgfem_mvci_sliver *s, int node) {
    dgfem_vec3 bounds[3], along = s->n;
    dgfem_real distance = dgfem_mvci_dot(s->n, dgfem_mvci_sub(s->mesh->rest[node], s->origin));
    int rank = dgfem_mvci_node_bounds(s, node, bounds);
    for (int i = 0; i < rank; i++) along = dgfem_mvci_axpy(along, -dgfem_mvci_dot(along, bounds[i]), bounds[i]);
    dgfem_real part = dgfem_mvci_dot(along, s->n);
    if (rank == 3 || part < DGFEM_R(0.1) || distance == 0) return;
    dgfem_mvci_move_node(s, node, dgfem_mvci_scale(-distance / part, along));
}

/* Where faces of the element are on the boundary of the body the plane is theirs. 0 where they do not agree. */
static int dgfem_mvci_sliver_plane(dgfem_mvci_sliver *s, int element) {
    int face_count, found = 0;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    dgfem_real least = s->diameter * s->diameter / 1000;
    for (int k = 0; k < face_count; k++) {
        int count, other = s->mesh->faces[faces[k] / 2].owner[!(faces[k] & 1)];
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        dgfem_real area = dgfem_mvci_projected_area(s, faces[k]);
        if (other != DGFEM_NONE || dgfem_mvci_abs(area) < least) continue;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(s->mesh->rest, loop, count));
        if (found && dgfem_mvci_norm(dgfem_mvci_cross(normal, s->n)) > DGFEM_R(1e-5)) return 0;
        if (found && area < 0) return 0; /* s->n points out of it; -n would of a second one on the other side */
        if (found) continue;
        found = 1;
        s->n = normal;
        s->origin = s->mesh->rest[loop[0]];
        s->u = dgfem_mvci_unit(dgfem_mvci_axpy(s->u, -dgfem_mvci_dot(s->u, s->n), s->n));
        s->v = dgfem_mvci_cross(s->n, s->u);
    }
    return 1;
}

/* ---- welding ---- */

/* Removes what is double in a loop or runs back. Returns what is left, -1 where the loop would touch itself. */
static int dgfem_mvci_clean_loop(int *loop, int count) {
    for (int i = 0; i < count && count > 2;) {
        int previous = loop[(i + count - 1) % count], next = loop[(i + 1) % count];
        if (loop[i] != next && previous != next) {
            i++;
            continue;
        }
        for (int j = i; j + 1 < count; j++) loop[j] = loop[j + 1];
        count--;
        i = 0;
    }
    for (int i = 0; i < count && count > 2; i++)
        for (int j = i + 1; j < count; j++)
            if (loop[i] == loop[j]) return -1;
    return count;
}

/* Gives a face the loop in s->buffer. */
static int dgfem_mvci_put_loop(dgfem_mvci_sliver *s, int face) {
    int left = dgfem_mvci_clean_loop(s->buffer.data, s->buffer.count);
    if (left < 0) return DGFEM_MVCI_REFUSED;
    if (left < 3) dgfem_mvci_remove_face(s->mesh, face);
    else if (!dgfem_mvci_set_loop(s->mesh, face, s->buffer.data, left)) return DGFEM_MVCI_NO_MEMORY;
    return DGFEM_MVCI_DONE;
}

/* Welds s->nodes as s->root says. */
static int dgfem_mvci_weld(dgfem_mvci_sliver *s) {
    dgfem_mvci_mesh *mesh = s->mesh;
    for (int i = 0; i < s->nodes.count; i++) s->root.data[i] = dgfem_mvci_root(s->root.data, i);
    for (int k = 0; k < s->near.count; k++) {
        int f = s->near.data[k], result;
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (dgfem_mvci_append(s->hooks, &s->buffer, mesh->loops.data + mesh->faces[f].loop, mesh->faces[f].count) ==
            DGFEM_NONE)
            return DGFEM_MVCI_NO_MEMORY;
        for (int i = 0; i < s->buffer.count; i++) {
            int n = dgfem_mvci_position_in(&s->nodes, s->buffer.data[i]);
            if (n != DGFEM_NONE) s->buffer.data[i] = s->nodes.data[s->root.data[n]];
        }
        result = dgfem_mvci_put_loop(s, f);
        if (result <= 0) return result;
    }
    return DGFEM_MVCI_DONE;
}

/* Joins two nodes of the element; that which the boundary binds more stays. 0 where neither may move. */
static int dgfem_mvci_weld_pair(dgfem_mvci_sliver *s, int i, int j) {
    i = dgfem_mvci_root(s->root.data, i), j = dgfem_mvci_root(s->root.data, j);
    if (i == j) return 1;
    if (s->rank.data[i] == 3 && s->rank.data[j] == 3) return 0;
    if (s->rank.data[i] >= s->rank.data[j]) s->root.data[j] = i;
    else s->root.data[i] = j;
    return 1;
}

/* s->root: nothing welded; s->rank: of all nodes. */
static int dgfem_mvci_weld_begin(dgfem_mvci_sliver *s) {
    dgfem_vec3 bounds[3];
    s->root.count = s->rank.count = 0;
    for (int i = 0; i < s->nodes.count; i++)
        if (!dgfem_mvci_push(s->hooks, &s->root, i) ||
            !dgfem_mvci_push(s->hooks, &s->rank, dgfem_mvci_node_bounds(s, s->nodes.data[i], bounds)))
            return 0;
    return 1;
}

/* ---- the arrangement of edges in the plane ---- */

/* s->ends: all edges of the element, once each. */
static int dgfem_mvci_sliver_edges(dgfem_mvci_sliver *s, int element) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    s->ends.count = 0;
    if (!dgfem_mvci_edges_reset(s->hooks, &s->edges, dgfem_mvci_element_corners(s->mesh, element))) return 0;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *loop = dgfem_mvci_face_loop(s->mesh, faces[k] / 2, &count);
        for (int i = 0; i < count; i++) {
            dgfem_mvci_edge *edge = dgfem_mvci_edges_between(&s->edges, loop[i], loop[(i + 1) % count]);
            if (edge->value != DGFEM_NONE) continue;
            edge->value = 1;
            if (!dgfem_mvci_push(s->hooks, &s->ends, edge->a) || !dgfem_mvci_push(s->hooks, &s->ends, edge->b))
                return 0;
        }
    }
    return 1;
}

/* Puts a node into the edge from a to b of all faces that have it. A triangle of the three vanishes. */
static int dgfem_mvci_insert_into_edge(dgfem_mvci_sliver *s, int a, int b, int node) {
    dgfem_mvci_mesh *mesh = s->mesh;
    for (int k = 0; k < s->near.count; k++) {
        int f = s->near.data[k], count = mesh->faces[f].count, at = DGFEM_NONE, result;
        const int *loop = mesh->loops.data + mesh->faces[f].loop;
        if (mesh->faces[f].owner[0] == DGFEM_NONE) continue;
        for (int i = 0; i < count; i++) {
            int j = (i + 1) % count;
            if ((loop[i] == a && loop[j] == b) || (loop[i] == b && loop[j] == a)) at = i;
        }
        if (at == DGFEM_NONE) continue;
        s->buffer.count = 0;
        if (!dgfem_mvci_ints_room(s->hooks, &s->buffer, count + 1)) return DGFEM_MVCI_NO_MEMORY;
        for (int i = 0; i < count; i++) {
            s->buffer.data[s->buffer.count++] = loop[i];
            if (i == at) s->buffer.data[s->buffer.count++] = node;
        }
        result = dgfem_mvci_put_loop(s, f);
        if (result <= 0) return result;
    }
    return DGFEM_MVCI_DONE;
}

/* Whether an edge lies on the boundary of the body. */
static int dgfem_mvci_on_boundary(const dgfem_mvci_sliver *s, int a, int b) {
    const dgfem_mvci_mesh *mesh = s->mesh;
    for (int k = 0; k < s->near.count; k++) {
        const dgfem_mvci_face *face = &mesh->faces[s->near.data[k]];
        if (face->owner[0] == DGFEM_NONE || face->owner[1] != DGFEM_NONE) continue;
        for (int i = 0; i < face->count; i++) {
            int c = mesh->loops.data[face->loop + i], d = mesh->loops.data[face->loop + (i + 1) % face->count];
            if ((c == a && d == b) || (c == b && d == a)) return 1;
        }
    }
    return 0;
}

/* One node of the element on one of its edges, in projection, goes into that edge. *found tells. */
static int dgfem_mvci_settle_touching(dgfem_mvci_sliver *s, int *found) {
    double eps = 0.01 * (double)s->diameter;
    for (int l = 0; l < s->ends.count; l += 2) {
        double a[2], b[2], p[2];
        int first = s->ends.data[l], second = s->ends.data[l + 1];
        dgfem_mvci_sliver_place(s, first, a);
        dgfem_mvci_sliver_place(s, second, b);
        double square = dgfem_mvci_square(a, b), length = sqrt(square);
        for (int i = 0; i < s->nodes.count; i++) {
            int node = s->nodes.data[i];
            if (node == first || node == second) continue;
            dgfem_mvci_sliver_place(s, node, p);
            double t = ((p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1])) / square;
            if (t * length <= eps || (1 - t) * length <= eps) continue;
            if (fabs(dgfem_mvci_turn(a, b, p)) > eps * length) continue;
            *found = 1;
            return dgfem_mvci_insert_into_edge(s, first, second, node);
        }
    }
    return DGFEM_MVCI_DONE;
}

/* A node where two edges cross in projection: half way between them, or on that which is on the boundary. */
static int dgfem_mvci_add_crossing(dgfem_mvci_sliver *s, const int ends[4], const double t[2]) {
    dgfem_real weights[4], share = DGFEM_R(0.5);
    int bound[2];
    for (int k = 0; k < 2; k++) bound[k] = dgfem_mvci_on_boundary(s, ends[2 * k], ends[2 * k + 1]);
    if (bound[0] != bound[1]) share = bound[0] ? 1 : 0;
    for (int k = 0; k < 2; k++) {
        dgfem_real part = k ? 1 - share : share;
        weights[2 * k] = (1 - (dgfem_real)t[k]) * part;
        weights[2 * k + 1] = (dgfem_real)t[k] * part;
    }
    int first = share == 0 ? 2 : 0, count = share == 0 || share == 1 ? 2 : 4;
    int node = dgfem_mvci_add_node(s->mesh, ends + first, weights + first, count);
    if (node == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &s->nodes, node)) return DGFEM_MVCI_NO_MEMORY;
    int result = dgfem_mvci_insert_into_edge(s, ends[0], ends[1], node);
    return result > 0 ? dgfem_mvci_insert_into_edge(s, ends[2], ends[3], node) : result;
}

/* The first crossing of two edges becomes a node. *found tells. */
static int dgfem_mvci_settle_crossing(dgfem_mvci_sliver *s, int *found) {
    for (int l = 0; l < s->ends.count; l += 2)
        for (int m = l + 2; m < s->ends.count; m += 2) {
            double a[2], b[2], c[2], d[2], t[2];
            int ends[4];
            ends[0] = s->ends.data[l], ends[1] = s->ends.data[l + 1];
            ends[2] = s->ends.data[m], ends[3] = s->ends.data[m + 1];
            if (ends[0] == ends[2] || ends[0] == ends[3] || ends[1] == ends[2] || ends[1] == ends[3]) continue;
            dgfem_mvci_sliver_place(s, ends[0], a);
            dgfem_mvci_sliver_place(s, ends[1], b);
            dgfem_mvci_sliver_place(s, ends[2], c);
            dgfem_mvci_sliver_place(s, ends[3], d);
            double ta = dgfem_mvci_turn(c, d, a), tb = dgfem_mvci_turn(c, d, b);
            double tc = dgfem_mvci_turn(a, b, c), td = dgfem_mvci_turn(a, b, d);
            if (!((ta > 0 && tb < 0) || (ta < 0 && tb > 0)) || !((tc > 0 && td < 0) || (tc < 0 && td > 0))) continue;
            t[0] = ta / (ta - tb), t[1] = tc / (tc - td);
            *found = 1;
            return dgfem_mvci_add_crossing(s, ends, t);
        }
    return DGFEM_MVCI_DONE;
}

/* Makes the edges of the element meet at nodes only. */
static int dgfem_mvci_arrange(dgfem_mvci_sliver *s, int element) {
    for (int round = 0; round < 200; round++) {
        int found = 0, result;
        if (!dgfem_mvci_sliver_edges(s, element)) return DGFEM_MVCI_NO_MEMORY;
        result = dgfem_mvci_settle_touching(s, &found);
        if (result > 0 && !found) result = dgfem_mvci_settle_crossing(s, &found);
        if (result <= 0 || !found) return result;
    }
    return DGFEM_MVCI_REFUSED;
}

/* ---- cells ---- */

/* Where the edge that follows the one from a to b around the cell on its left ends: the next clockwise from a, at b. */
static int dgfem_mvci_next_around(const dgfem_mvci_sliver *s, int a, int b) {
    double p[2], q[2], best_angle = 0;
    int best = DGFEM_NONE;
    dgfem_mvci_sliver_place(s, b, q);
    dgfem_mvci_sliver_place(s, a, p);
    double back = atan2(p[1] - q[1], p[0] - q[0]);
    for (int l = 0; l < s->ends.count; l++) {
        if (s->ends.data[l] != b) continue;
        int c = s->ends.data[l ^ 1];
        dgfem_mvci_sliver_place(s, c, p);
        double angle = back - atan2(p[1] - q[1], p[0] - q[0]);
        while (angle <= 1e-12) angle += 6.283185307179586;
        if (c == a) angle = 6.283185307179586;
        if (best != DGFEM_NONE && angle >= best_angle) continue;
        best = c, best_angle = angle;
    }
    return best;
}

/* A point inside of the cell's polygon: the centroid of the largest of its triangles. */
static int dgfem_mvci_cell_point(dgfem_mvci_sliver *s, double out[2]) {
    int n = s->cell.count, best = 0;
    double largest = 0;
    if (!dgfem_mvci_polygon_room(s->hooks, &s->polygon, n)) return DGFEM_MVCI_NO_MEMORY;
    for (int i = 0; i < n; i++) {
        s->polygon.node[i] = i;
        dgfem_mvci_sliver_place(s, s->cell.data[i], s->polygon.point[i]);
    }
    s->polygon.count = n;
    s->polygon.flat = 0;
    int count = dgfem_mvci_polygon_triangulate(&s->polygon);
    const int *t = s->polygon.triangles;
    for (int i = 0; i < count; i++) {
        double area =
            dgfem_mvci_turn(s->polygon.point[t[3 * i]], s->polygon.point[t[3 * i + 1]], s->polygon.point[t[3 * i + 2]]);
        if (area > largest) largest = area, best = i;
    }
    for (int j = 0; j < 2; j++)
        out[j] = count ? (s->polygon.point[t[3 * best]][j] + s->polygon.point[t[3 * best + 1]][j] +
                          s->polygon.point[t[3 * best + 2]][j]) /
                             3
                       : 0;
    return count ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* The element beyond the only face on one side (1 above, -1 below) that covers a point. *faces counts such faces. */
static int dgfem_mvci_beyond(const dgfem_mvci_sliver *s, int element, int side, const double p[2], int *faces) {
    int face_count, beyond = DGFEM_NONE;
    const int *list = dgfem_mvci_element_faces(s->mesh, element, &face_count);
    *faces = 0;
    for (int k = 0; k < face_count; k++) {
        int count, inside = 0;
        const int *loop = dgfem_mvci_face_loop(s->mesh, list[k] / 2, &count);
        if (dgfem_mvci_projected_area(s, list[k]) * (dgfem_real)side <= 0) continue;
        for (int i = 0; i < count; i++) {
            double a[2], b[2];
            dgfem_mvci_sliver_place(s, loop[i], a);
            dgfem_mvci_sliver_place(s, loop[(i + 1) % count], b);
            if ((a[1] > p[1]) == (b[1] > p[1])) continue;
            if (p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])) inside = !inside;
        }
        if (!inside) continue;
        beyond = s->mesh->faces[list[k] / 2].owner[!(list[k] & 1)];
        ++*faces;
    }
    return beyond;
}

/* The cell in s->cell becomes a face between what is above and below. */
static int dgfem_mvci_close_cell(dgfem_mvci_sliver *s, int element) {
    double p[2];
    int faces_above, faces_below, result = dgfem_mvci_cell_point(s, p);
    if (result <= 0) return result;
    int above = dgfem_mvci_beyond(s, element, 1, p, &faces_above);
    int below = dgfem_mvci_beyond(s, element, -1, p, &faces_below);
    if (faces_above != 1 || faces_below != 1) return DGFEM_MVCI_REFUSED;
    if (above == below) return above == DGFEM_NONE ? DGFEM_MVCI_REFUSED : DGFEM_MVCI_DONE;
    if (below == DGFEM_NONE) {
        dgfem_mvci_reverse(s->cell.data, s->cell.count);
        below = above, above = DGFEM_NONE;
    }
    int from = DGFEM_NONE, wall = 0;
    for (int k = 0; above == DGFEM_NONE && k < s->mesh->elements[element].face_count; k++) {
        const dgfem_mvci_face *face =
            &s->mesh->faces[s->mesh->element_faces.data[s->mesh->elements[element].face + k] / 2];
        if (face->owner[1] == DGFEM_NONE) from = face->from, wall = face->wall;
    }
    /* kept aside: the element's own faces are removed when all cells are known */
    int face = dgfem_mvci_add_face(s->mesh, below, above, s->cell.data, s->cell.count, from, wall);
    if (face == DGFEM_NONE || !dgfem_mvci_push(s->hooks, &s->list, face) || !dgfem_mvci_push(s->hooks, &s->near, face))
        return DGFEM_MVCI_NO_MEMORY;
    return DGFEM_MVCI_DONE;
}

/* Follows every edge both ways around the cells of the plane; those of positive area become faces. */
static int dgfem_mvci_close_cells(dgfem_mvci_sliver *s, int element) {
    s->list.count = 0;
    if (!dgfem_mvci_sliver_edges(s, element) || !dgfem_mvci_edges_reset(s->hooks, &s->edges, s->ends.count))
        return DGFEM_MVCI_NO_MEMORY;
    for (int l = 0; l < s->ends.count; l++) {
        int a = s->ends.data[l], b = s->ends.data[l ^ 1], start = a, second = b;
        if (dgfem_mvci_edges_find(&s->edges, a, b) != DGFEM_NONE) continue;
        s->cell.count = 0;
        do {
            int next = dgfem_mvci_next_around(s, a, b);
            dgfem_mvci_edges_at(&s->edges, a, b)->value = 1;
            if (!dgfem_mvci_push(s->hooks, &s->cell, a)) return DGFEM_MVCI_NO_MEMORY;
            if (next == DGFEM_NONE || s->cell.count > s->ends.count) return DGFEM_MVCI_REFUSED;
            a = b, b = next;
        } while (a != start || b != second);
        dgfem_vec3 area = dgfem_mvci_loop_area(s->mesh->rest, s->cell.data, s->cell.count);
        if (s->cell.count < 3 || !(dgfem_mvci_dot(area, s->n) > 0)) continue;
        int result = dgfem_mvci_close_cell(s, element);
        if (result <= 0) return result;
    }
    return s->list.count ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* ---- one removal ---- */

/* Presses an element into its plane. */
static int dgfem_mvci_flatten(dgfem_mvci_sliver *s, int element) {
    dgfem_mvci_mesh *mesh = s->mesh;
    dgfem_real extent[3], eps;
    int result;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    dgfem_mvci_sliver_axes(s, extent);
    if (!dgfem_mvci_sliver_near(s)) return DGFEM_MVCI_NO_MEMORY;
    if (!dgfem_mvci_sliver_plane(s, element)) return DGFEM_MVCI_REFUSED;
    for (int i = 0; i < s->nodes.count; i++) dgfem_mvci_press_node(s, s->nodes.data[i]);

    eps = s->diameter / 50;
    if (!dgfem_mvci_weld_begin(s)) return DGFEM_MVCI_NO_MEMORY;
    for (int i = 0; i < s->nodes.count; i++)
        for (int j = i + 1; j < s->nodes.count; j++) {
            double p[2], q[2];
            dgfem_mvci_sliver_place(s, s->nodes.data[i], p);
            dgfem_mvci_sliver_place(s, s->nodes.data[j], q);
            if (dgfem_mvci_square(p, q) < (double)(eps * eps) && !dgfem_mvci_weld_pair(s, i, j))
                return DGFEM_MVCI_REFUSED;
        }
    result = dgfem_mvci_weld(s);
    if (result <= 0) return result;
    if (!mesh->elements[element].face_count) return DGFEM_MVCI_DONE;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    result = dgfem_mvci_arrange(s, element);
    if (result > 0) result = dgfem_mvci_close_cells(s, element);
    if (result <= 0) return result;

    while (mesh->elements[element].face_count)
        dgfem_mvci_remove_face(mesh, mesh->element_faces.data[mesh->elements[element].face] / 2);
    for (int k = 0; k < s->list.count; k++)
        for (int side = 0; side < 2; side++) {
            int owner = mesh->faces[s->list.data[k]].owner[side];
            if (owner != DGFEM_NONE && !dgfem_mvci_add_element_face(mesh, owner, s->list.data[k], side))
                return DGFEM_MVCI_NO_MEMORY;
        }
    return DGFEM_MVCI_DONE;
}

/* Welds the ends of a needle's short edges. */
static int dgfem_mvci_collapse(dgfem_mvci_sliver *s, int element, dgfem_real thickness) {
    if (!dgfem_mvci_sliver_near(s) || !dgfem_mvci_weld_begin(s) || !dgfem_mvci_sliver_edges(s, element))
        return DGFEM_MVCI_NO_MEMORY;
    for (int l = 0; l < s->ends.count; l += 2) {
        int a = s->ends.data[l], b = s->ends.data[l + 1];
        if (dgfem_mvci_distance(s->mesh->rest[a], s->mesh->rest[b]) > DGFEM_R(1.5) * thickness) continue;
        if (!dgfem_mvci_weld_pair(s, dgfem_mvci_position_in(&s->nodes, a), dgfem_mvci_position_in(&s->nodes, b)))
            return DGFEM_MVCI_REFUSED;
    }
    return dgfem_mvci_weld(s);
}

/* Queues affected elements that have lost their volume. */
static int dgfem_mvci_queue_flat(dgfem_mvci_sliver *s) {
    for (int i = 0; i < s->affected.count; i++) {
        dgfem_vec3 centre;
        dgfem_real diameter;
        int other = s->affected.data[i];
        if (!s->mesh->elements[other].face_count || dgfem_mvci_position_in(&s->queue, other) != DGFEM_NONE) continue;
        dgfem_real volume = dgfem_mvci_element_measure(s->mesh, other, &centre);
        (void)dgfem_mvci_element_area(s->mesh, other, &diameter);
        if (volume <= diameter * diameter * diameter * DGFEM_R(1e-6) && !dgfem_mvci_push(s->hooks, &s->queue, other))
            return 0;
    }
    return 1;
}

/* Flattens what is queued, and what becomes flat thereby. */
static int dgfem_mvci_flatten_queued(dgfem_mvci_sliver *s) {
    for (int done = 0; done < s->queue.count; done++) {
        int element = s->queue.data[done], result;
        if (done > 8) return DGFEM_MVCI_REFUSED;
        if (!s->mesh->elements[element].face_count) continue;
        result = dgfem_mvci_flatten(s, element);
        if (result <= 0) return result;
        dgfem_status status = dgfem_mvci_mesh_settle(s->mesh, NULL);
        if (status) return status == DGFEM_ERROR_MEMORY ? DGFEM_MVCI_NO_MEMORY : DGFEM_MVCI_REFUSED;
        if (!dgfem_mvci_queue_flat(s)) return DGFEM_MVCI_NO_MEMORY;
    }
    return DGFEM_MVCI_DONE;
}

/* Whether the elements around are good, and as large together as before. */
static int dgfem_mvci_accept_removal(dgfem_mvci_sliver *s, const dgfem_mvci_mesh *before, dgfem_real quality) {
    dgfem_vec3 moment_before, moment_after;
    for (int i = 0; i < s->affected.count; i++) {
        int other = s->affected.data[i];
        if (!s->mesh->elements[other].face_count) continue;
        int closed = dgfem_mvci_element_is_closed(s->mesh, other, &s->edges);
        if (closed <= 0) return closed ? DGFEM_MVCI_NO_MEMORY : DGFEM_MVCI_REFUSED;
        if (!dgfem_mvci_element_is_good(s->mesh, other)) return DGFEM_MVCI_REFUSED;
        dgfem_real now = dgfem_mvci_element_quality(s->mesh, other);
        if (now < DGFEM_R(0.99) * quality && now < DGFEM_R(0.3) * dgfem_mvci_element_quality(before, other))
            return DGFEM_MVCI_REFUSED; /* a slab may become a wedge, to be removed next */
    }
    dgfem_real volume_before = dgfem_mvci_affected_volume(s, before, &moment_before);
    dgfem_real volume_after = dgfem_mvci_affected_volume(s, s->mesh, &moment_after);
    dgfem_real limit = volume_before * (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-11));
    dgfem_real moment = dgfem_mvci_norm(dgfem_mvci_sub(moment_after, moment_before));
    if (!(dgfem_mvci_abs(volume_after - volume_before) <= limit)) return DGFEM_MVCI_REFUSED;
    return moment <= limit * 10 * s->diameter ? DGFEM_MVCI_DONE : DGFEM_MVCI_REFUSED;
}

/* Removes an element from s->mesh, a copy of `before`, which is spoilt where that fails. `quality` is the element's. */
static int dgfem_mvci_remove_sliver(dgfem_mvci_sliver *s, const dgfem_mvci_mesh *before, int element,
                                    dgfem_real quality) {
    dgfem_real extent[3];
    s->affected.count = s->queue.count = 0;
    if (!dgfem_mvci_sliver_nodes(s, element)) return DGFEM_MVCI_NO_MEMORY;
    dgfem_mvci_sliver_axes(s, extent);
    if (extent[0] > extent[1] / 5 && extent[1] > extent[2] / 5) return DGFEM_MVCI_REFUSED;
    if (extent[1] < extent[2] / 10) {
        int result = dgfem_mvci_collapse(s, element, extent[1]);
        if (result <= 0) return result;
    }
    if (s->mesh->elements[element].face_count && !dgfem_mvci_push(s->hooks, &s->queue, element))
        return DGFEM_MVCI_NO_MEMORY;
    dgfem_status status = dgfem_mvci_mesh_settle(s->mesh, NULL);
    if (status == DGFEM_ERROR_MEMORY) return DGFEM_MVCI_NO_MEMORY;
    if (!s->queue.count && !dgfem_mvci_queue_flat(s)) return DGFEM_MVCI_NO_MEMORY;
    if (status && !s->queue.count) return DGFEM_MVCI_REFUSED;
    int result = dgfem_mvci_flatten_queued(s);
    return result > 0 ? dgfem_mvci_accept_removal(s, before, quality) : result;
}

/* The worst changed element below the quality that has not been tried; *quality becomes its own. */
static int dgfem_mvci_worst_sliver(const dgfem_mvci_mesh *mesh, const dgfem_real *known, const char *tried,
                                   dgfem_real *quality) {
    int worst = DGFEM_NONE;
    for (int e = 0; e < mesh->element_count; e++)
        if (mesh->elements[e].face_count && !tried[e] && known[e] < *quality) worst = e, *quality = known[e];
    return worst;
}

/* Removes what is below the quality, the worst first; of changed elements only where not `all`. *mesh is replaced.
   *removed counts the elements that vanished, *left those below that could not be removed. */
static dgfem_status dgfem_mvci_mesh_remove_slivers(dgfem_mvci_mesh **mesh, dgfem_real quality, int all, int *removed,
                                                   int *left) {
    dgfem_mvci_sliver sliver;
    dgfem_hooks hooks = (*mesh)->hooks;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&hooks);
    size_t count = (size_t)(*mesh)->element_count;
    char *tried = (char *)dgfem_mvci_take(&scratch, count, 1);
    dgfem_real *known = (dgfem_real *)dgfem_mvci_take(&scratch, count, sizeof(dgfem_real));
    dgfem_status status = tried && known ? DGFEM_OK : DGFEM_ERROR_MEMORY;
    int changed = 0;
    memset(&sliver, 0, sizeof sliver);
    sliver.hooks = &hooks;
    for (int e = 0; !status && e < (*mesh)->element_count; e++) {
        tried[e] = !all && !(*mesh)->elements[e].changed;
        if (!tried[e]) known[e] = dgfem_mvci_element_quality(*mesh, e);
    }
    while (!status) {
        dgfem_real worst = quality;
        int element = dgfem_mvci_worst_sliver(*mesh, known, tried, &worst);
        if (element == DGFEM_NONE) break;
        tried[element] = 1;
        sliver.mesh = dgfem_mvci_mesh_copy(*mesh);
        int result = sliver.mesh ? dgfem_mvci_remove_sliver(&sliver, *mesh, element, worst) : DGFEM_MVCI_NO_MEMORY;
        if (result <= 0) {
            dgfem_mvci_mesh_destroy(sliver.mesh);
            if (result < 0) status = DGFEM_ERROR_MEMORY;
            continue;
        }
        dgfem_mvci_mesh_destroy(*mesh);
        *mesh = sliver.mesh;
        changed = 1;
        for (int i = 0; i < sliver.affected.count; i++) {
            int other = sliver.affected.data[i];
            if (!(*mesh)->elements[other].face_count) {
                ++*removed;
                tried[other] = 1;
                continue;
            }
            known[other] = dgfem_mvci_element_quality(*mesh, other);
            tried[other] = 0; /* what is different may be possible */
        }
    }
    for (int e = 0; !status && e < (*mesh)->element_count; e++)
        *left += (*mesh)->elements[e].face_count && (all || (*mesh)->elements[e].changed) && known[e] < quality;
    if (!status && changed && !dgfem_mvci_mesh_compact(*mesh)) status = DGFEM_ERROR_MEMORY;
    dgfem_mvci_sliver_free(&sliver);
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

/* ==== cut.c ======================================================================================================= */

/* Cuts of meshes and bodies. */

/* ---- blades ---- */

static void dgfem_mvci_blade_axes(dgfem_mvci_blade *blade, dgfem_vec3 normal, dgfem_vec3 origin) {
    dgfem_real ax = dgfem_mvci_abs(normal.x), ay = dgfem_mvci_abs(normal.y), az = dgfem_mvci_abs(normal.z);
    dgfem_vec3 axis = dgfem_mvci_vec3(ax <= ay && ax <= az, ay < ax && ay <= az, az < ax && az < ay);
    blade->plane.normal = normal;
    blade->plane.offset = dgfem_mvci_dot(normal, origin);
    blade->origin = origin;
    blade->u = dgfem_mvci_unit(dgfem_mvci_cross(axis, normal));
    blade->v = dgfem_mvci_cross(normal, blade->u);
}

/* The polygon of `count` points becomes counter-clockwise in the blade's coordinates. 0 when out of memory, -1 where it
   has no area. */
static int dgfem_mvci_blade_set(const dgfem_hooks *hooks, dgfem_mvci_blade *blade, const dgfem_vec3 *points,
                                int count) {
    dgfem_vec3 area = dgfem_mvci_vec3(0, 0, 0), middle = area;
    dgfem_real longest = 0;
    for (int i = 0; i < count; i++) {
        middle = dgfem_mvci_axpy(middle, 1 / (dgfem_real)count, points[i]);
        longest = dgfem_mvci_max(longest, dgfem_mvci_distance(points[0], points[i]));
        if (i < 2) continue;
        area = dgfem_mvci_add(
            area, dgfem_mvci_cross(dgfem_mvci_sub(points[i - 1], points[0]), dgfem_mvci_sub(points[i], points[0])));
    }
    if (!(dgfem_mvci_norm(area) > (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9)) * longest * longest)) return -1;
    dgfem_mvci_blade_axes(blade, dgfem_mvci_unit(area), middle);
    blade->polygon.count = 0;
    for (int i = 0; i < count; i++) {
        double p[2];
        dgfem_mvci_blade_place(blade, points[i], p);
        if (!dgfem_mvci_points_push(hooks, &blade->polygon, p[0], p[1])) return 0;
    }
    return 1;
}

/* ---- attempts ---- */

/* Whether a blade meets anything. Negative when out of memory. */
static int dgfem_mvci_blade_meets(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                  int open, dgfem_mvci_cracks *cracks) {
    if (!dgfem_mvci_select(s, mesh, blade)) return -1;
    if (s->selected.count || !open) return s->selected.count > 0;
    return dgfem_mvci_find_blade_faces(s, mesh, cracks) ? cracks->faces.count > 0 : -1;
}

/* Repeats attempts until one succeeds: at the latest when all elements are sealed, for then nothing is changed. */
static dgfem_status dgfem_mvci_try_cuts(dgfem_mvci_splitter *s, const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade,
                                        int open, dgfem_mvci_cracks *cracks, dgfem_mvci_mesh **out) {
    for (int attempt = 0;; attempt++) {
        dgfem_mvci_mesh *copy = dgfem_mvci_mesh_copy(mesh);
        dgfem_status status = copy ? dgfem_mvci_cut_attempt(s, copy, blade, open, cracks) : DGFEM_ERROR_MEMORY;
        for (int e = 0; !status && e < mesh->element_count; e++) copy->elements[e].changed |= mesh->elements[e].changed;
        if (!status && !dgfem_mvci_mesh_compact(copy)) status = DGFEM_ERROR_MEMORY;
        if (!status) *out = copy;
        else dgfem_mvci_mesh_destroy(copy);
        if (status != DGFEM_ERROR_DEGENERATE) return status;
        int learned = dgfem_mvci_splitter_learn(s, attempt);
        if (learned <= 0) return learned ? DGFEM_ERROR_MEMORY : status;
    }
}

/* Cuts a mesh, or splits its elements where not `open`. *out is what becomes of it, NULL where nothing does. */
static dgfem_status dgfem_mvci_mesh_cut(const dgfem_mvci_mesh *mesh, dgfem_mvci_blade *blade, int current,
                                        dgfem_real snap, int open, dgfem_mvc_cut_info *info, dgfem_mvci_mesh **out) {
    dgfem_mvci_splitter splitter;
    dgfem_mvci_cracks cracks;
    dgfem_status status = DGFEM_OK;
    *out = NULL;
    memset(&cracks, 0, sizeof cracks);
    int meets = dgfem_mvci_splitter_make(&splitter, &mesh->hooks, mesh, blade->plane, current, snap) ? 0 : -1;
    if (!meets) meets = dgfem_mvci_blade_meets(&splitter, mesh, blade, open, &cracks);
    if (meets < 0) status = DGFEM_ERROR_MEMORY;
    if (meets > 0) status = dgfem_mvci_try_cuts(&splitter, mesh, blade, open, &cracks, out);
    if (!status) info->elements_kept += splitter.elements_kept;
    if (*out && !splitter.elements_split && !splitter.nodes_added && !cracks.faces.count) {
        dgfem_mvci_mesh_destroy(*out);
        *out = NULL;
    }
    if (*out) {
        info->elements_split += splitter.elements_split;
        info->nodes_added += splitter.nodes_added;
        info->nodes_copied += cracks.nodes_copied;
        info->faces_cut += cracks.faces.count;
    }
    dgfem_mvci_cracks_free(&mesh->hooks, &cracks);
    dgfem_mvci_splitter_free(&splitter);
    return status;
}

/* ---- pieces ---- */

/* piece_of[element_count], numbered in the order of their first elements. Returns their number, -1 when out of
   memory. */
static int dgfem_mvci_mesh_pieces(const dgfem_mvci_mesh *mesh, int *piece_of) {
    int *root = (int *)dgfem_mvci_allocate(&mesh->hooks, (size_t)mesh->element_count, sizeof(int)), count = 0;
    if (!root) return -1;
    for (int e = 0; e < mesh->element_count; e++) root[e] = e;
    for (int f = 0; f < mesh->face_count; f++)
        if (mesh->faces[f].owner[1] != DGFEM_NONE)
            dgfem_mvci_join(root, mesh->faces[f].owner[0], mesh->faces[f].owner[1]);
    for (int e = 0; e < mesh->element_count; e++) {
        int first = dgfem_mvci_root(root, e); /* the lowest of its class */
        piece_of[e] = first == e ? count++ : piece_of[first];
    }
    dgfem_mvci_free(&mesh->hooks, root);
    return count;
}

/* Sums over nodes; `centre` is sum m x and `spin` the angular momentum about the origin until the end. */
static void dgfem_mvci_piece_add(const dgfem_mvc *body, int node, dgfem_piece *piece) {
    dgfem_vec3 x = body->position[node], p = dgfem_mvci_scale(body->mass[node], body->velocity[node]);
    piece->mass += body->mass[node];
    piece->centre = dgfem_mvci_axpy(piece->centre, body->mass[node], x);
    piece->momentum = dgfem_mvci_add(piece->momentum, p);
    piece->spin = dgfem_mvci_add(piece->spin, dgfem_mvci_cross(x, p));
}

/* `seen` has a zero for each node. */
static void dgfem_mvci_measure_pieces(const dgfem_mvc *body, const int *piece_of, char *seen, dgfem_piece *pieces,
                                      int room) {
    memset(pieces, 0, (size_t)room * sizeof *pieces);
    for (int e = 0; e < body->element_count; e++) {
        int face_count;
        const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
        if (piece_of[e] >= room) continue;
        pieces[piece_of[e]].element_count++;
        pieces[piece_of[e]].volume += body->volume[e];
        for (int k = 0; k < face_count; k++) {
            int count;
            const int *loop = dgfem_mvci_face_loop(body->mesh, faces[k] / 2, &count);
            for (int i = 0; i < count; i++)
                if (!seen[loop[i]]) dgfem_mvci_piece_add(body, loop[i], &pieces[piece_of[e]]), seen[loop[i]] = 1;
        }
    }
    for (int k = 0; k < room; k++) {
        pieces[k].centre = dgfem_mvci_scale(1 / pieces[k].mass, pieces[k].centre);
        pieces[k].spin = dgfem_mvci_sub(pieces[k].spin, dgfem_mvci_cross(pieces[k].centre, pieces[k].momentum));
    }
}

DGFEM_API dgfem_status dgfem_mvc_pieces(const dgfem_mvc *body, int *piece_of, dgfem_piece *pieces, int capacity,
                                        int *count) {
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!count || capacity < 0)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "pieces: room for %d, or no count", capacity);
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    int *own = (int *)dgfem_mvci_take(&scratch, (size_t)body->element_count, sizeof(int));
    char *seen = (char *)dgfem_mvci_take(&scratch, (size_t)body->node_count, 1);
    int found = own && seen ? dgfem_mvci_mesh_pieces(body->mesh, own) : -1;
    if (found >= 0) {
        int room = pieces ? (found < capacity ? found : capacity) : 0;
        *count = found;
        if (piece_of) memcpy(piece_of, own, (size_t)body->element_count * sizeof(int));
        if (room) dgfem_mvci_measure_pieces(body, own, seen, pieces, room);
    }
    dgfem_mvci_scratch_free(&scratch);
    return found >= 0 ? DGFEM_OK : dgfem_mvci_fail_memory(&body->hooks);
}

DGFEM_API dgfem_real dgfem_mvc_quality(const dgfem_mvc *body, int element) {
    if (!body || element < 0 || element >= body->element_count) return 0;
    return dgfem_mvci_element_quality(body->mesh, element);
}

DGFEM_API int dgfem_mvc_face_is_wall(const dgfem_mvc *body, int face) {
    if (!body || face < 0 || face >= body->face_count) return 0;
    return body->mesh->faces[face].wall && body->mesh->faces[face].owner[1] == DGFEM_NONE;
}

/* ---- cuts of a body ---- */

/* A mesh that cuts replace, and what is needed to tell of new pieces. */
typedef struct dgfem_mvci_job {
    dgfem_mvc *body;
    const dgfem_mvc_cut_desc *desc;
    dgfem_real snap;
    dgfem_mvci_mesh *mesh; /* NULL: that of the body still */
    dgfem_mvci_blade blade;
    dgfem_mvc_cut_info info;
    dgfem_mvci_scratch scratch;
    int *old_piece;     /* [new elements] piece before */
    int *piece;         /* [new elements] */
    int *largest;       /* [pieces before] largest of the pieces that it has become */
    int *elements;      /* of one piece */
    dgfem_real *volume; /* [new pieces] */
} dgfem_mvci_job;

static dgfem_status dgfem_mvci_job_blade(dgfem_mvci_job *job, int open) {
    const dgfem_mvci_mesh *mesh = job->mesh ? job->mesh : job->body->mesh;
    dgfem_mvci_mesh *next;
    dgfem_status status =
        dgfem_mvci_mesh_cut(mesh, &job->blade, job->desc->current, job->snap, open, &job->info, &next);
    if (!next) return status;
    dgfem_mvci_mesh_destroy(job->mesh);
    job->mesh = next;
    return status;
}

/* Numbers the pieces before the body takes over the new mesh, so that nothing can fail afterwards. */
static dgfem_status dgfem_mvci_job_pieces(dgfem_mvci_job *job) {
    size_t old_count = (size_t)job->body->element_count, count = (size_t)job->mesh->element_count;
    int *before = (int *)dgfem_mvci_take(&job->scratch, old_count, sizeof(int));
    job->old_piece = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->piece = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->largest = (int *)dgfem_mvci_take(&job->scratch, old_count, sizeof(int));
    job->elements = (int *)dgfem_mvci_take(&job->scratch, count, sizeof(int));
    job->volume = (dgfem_real *)dgfem_mvci_take(&job->scratch, count, sizeof(dgfem_real));
    if (!before || !job->old_piece || !job->piece || !job->largest || !job->elements || !job->volume ||
        dgfem_mvci_mesh_pieces(job->body->mesh, before) < 0)
        return DGFEM_ERROR_MEMORY;
    job->info.pieces = dgfem_mvci_mesh_pieces(job->mesh, job->piece);
    if (job->info.pieces < 0) return DGFEM_ERROR_MEMORY;
    for (int e = 0; e < job->mesh->element_count; e++) {
        dgfem_vec3 centre;
        job->old_piece[e] = before[job->mesh->elements[e].from];
        job->volume[job->piece[e]] += dgfem_mvci_element_measure(job->mesh, e, &centre);
    }
    for (int i = 0; i < job->body->element_count; i++) job->largest[i] = DGFEM_NONE;
    for (int e = 0; e < job->mesh->element_count; e++) {
        int *largest = &job->largest[job->old_piece[e]];
        if (*largest == DGFEM_NONE || job->volume[job->piece[e]] > job->volume[*largest]) *largest = job->piece[e];
    }
    return DGFEM_OK;
}

static void dgfem_mvci_job_tell(const dgfem_mvci_job *job) {
    for (int k = 0; job->desc->new_piece && k < job->info.pieces; k++) {
        int count = 0, is_new = 0;
        for (int e = 0; e < job->body->element_count; e++) {
            if (job->piece[e] != k) continue;
            is_new = job->largest[job->old_piece[e]] != k;
            job->elements[count++] = e;
        }
        if (is_new) job->desc->new_piece(job->desc->new_piece_user, job->body, k, job->elements, count);
    }
}

static dgfem_mvci_job dgfem_mvci_job_make(dgfem_mvc *body, const dgfem_mvc_cut_desc *desc) {
    dgfem_mvci_job job;
    memset(&job, 0, sizeof job);
    job.body = body, job.desc = desc;
    job.snap = desc->snap;
    job.scratch = dgfem_mvci_scratch_make(&body->hooks);
    return job;
}

/* Removes slivers, gives the mesh to the body, tells of new pieces; frees what the job has. `all`: slivers everywhere,
   else of what has changed. Logs a failure. */
static dgfem_status dgfem_mvci_job_end(dgfem_mvci_job *job, dgfem_status status, int all, dgfem_mvc_cut_info *info) {
    dgfem_mvc *body = job->body;
    if (!status && all && !job->mesh) {
        job->mesh = dgfem_mvci_mesh_copy(body->mesh);
        if (!job->mesh) status = DGFEM_ERROR_MEMORY;
    }
    if (!status && job->mesh && job->desc->remove_slivers)
        status = dgfem_mvci_mesh_remove_slivers(&job->mesh, job->desc->quality, all, &job->info.slivers_removed,
                                                &job->info.slivers_left);
    int changed = job->info.elements_split || job->info.nodes_added || job->info.faces_cut || job->info.slivers_removed;
    if (!status && job->mesh) status = dgfem_mvci_job_pieces(job);
    if (status == DGFEM_ERROR_MEMORY) (void)dgfem_mvci_fail_memory(&body->hooks);
    if (status == DGFEM_ERROR_DEGENERATE)
        (void)dgfem_mvci_fail(&body->hooks, status,
                              "cut: no way to cut the elements here leaves all of them star-shaped");
    if (!status && job->mesh && changed) {
        status = dgfem_mvci_body_accept_mesh(body, job->mesh);
        if (!status) job->mesh = NULL;
        if (!status) dgfem_mvci_job_tell(job);
    }
    if (!status && !job->info.pieces) status = dgfem_mvc_pieces(body, NULL, NULL, 0, &job->info.pieces);
    if (!status && info) *info = job->info;
    dgfem_mvci_mesh_destroy(job->mesh);
    dgfem_mvci_blade_free(&body->hooks, &job->blade);
    dgfem_mvci_scratch_free(&job->scratch);
    return status;
}

/* ---- public ---- */

DGFEM_API dgfem_mvc_cut_desc dgfem_default_mvc_cut_desc(void) {
    dgfem_mvc_cut_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.current = 1;
    desc.snap = DGFEM_R(0.05);
    desc.remove_slivers = 1;
    desc.quality = DGFEM_R(0.02);
    return desc;
}

static dgfem_status dgfem_mvci_check_cut(const dgfem_mvc *body, const dgfem_mvc_cut_desc *desc) {
    if (desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    if (!(desc->snap >= 0 && desc->snap < DGFEM_R(0.5)))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: snap %g is not in [0, 0.5)",
                               (double)desc->snap);
    if (!(desc->quality >= 0 && desc->quality < DGFEM_R(0.2)))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: quality %g is not in [0, 0.2)",
                               (double)desc->quality);
    return DGFEM_OK;
}

/* element: the only one to be split, or DGFEM_NONE. */
static dgfem_status dgfem_mvci_body_plane(dgfem_mvc *body, int element, dgfem_plane plane,
                                          const dgfem_mvc_cut_desc *desc, int open, dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (status) return status;
    if (!dgfem_mvci_is_finite3(plane.normal) || !dgfem_mvci_is_finite(plane.offset))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: the plane");
    dgfem_real length = dgfem_mvci_norm(plane.normal);
    if (!(length > 0)) return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: the plane's normal is zero");
    if (!dgfem_mvci_is_finite(length))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: the length of the plane's normal");
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    dgfem_vec3 normal = dgfem_mvci_scale(1 / length, plane.normal);
    dgfem_mvci_blade_axes(&job.blade, normal, dgfem_mvci_scale(plane.offset / length, normal));
    job.blade.single = element != DGFEM_NONE;
    job.blade.element = element;
    status = dgfem_mvci_job_blade(&job, open);
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_split_element(dgfem_mvc *body, int element, dgfem_plane plane,
                                               const dgfem_mvc_cut_desc *desc, dgfem_mvc_cut_info *info) {
    if (info) memset(info, 0, sizeof *info);
    if (body && (element < 0 || element >= body->element_count))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "split: there is no element %d", element);
    return dgfem_mvci_body_plane(body, element, plane, desc, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_split_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    return dgfem_mvci_body_plane(body, DGFEM_NONE, plane, desc, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_cut_plane(dgfem_mvc *body, dgfem_plane plane, const dgfem_mvc_cut_desc *desc,
                                           dgfem_mvc_cut_info *info) {
    return dgfem_mvci_body_plane(body, DGFEM_NONE, plane, desc, 1, info);
}

/* Points that exist and are finite. */
static dgfem_status dgfem_mvci_check_blade_points(const dgfem_mvc *body, const dgfem_points_in *points) {
    dgfem_status status = dgfem_mvci_check_points(&body->hooks, points, "cut");
    for (int i = 0; !status && i < points->count; i++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(points, i)))
            status = dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_NOT_FINITE, "cut: point %d", i);
    return status;
}

/* Whether the blade's polygon crosses or touches itself, at which side. */
static int dgfem_mvci_blade_crosses(const dgfem_mvci_blade *blade, int *side) {
    const dgfem_mvci_points *polygon = &blade->polygon;
    int n = polygon->count;
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            const double *a = polygon->at[i], *b = polygon->at[(i + 1) % n], *c = polygon->at[j];
            const double *d = polygon->at[(j + 1) % n];
            *side = j;
            if (j == i + 1 || (!i && j == n - 1)) continue;
            double ta = dgfem_mvci_turn(c, d, a), tb = dgfem_mvci_turn(c, d, b);
            double tc = dgfem_mvci_turn(a, b, c), td = dgfem_mvci_turn(a, b, d);
            if (((ta >= 0 && tb <= 0) || (ta <= 0 && tb >= 0)) && ((tc >= 0 && td <= 0) || (tc <= 0 && td >= 0)) &&
                (ta != 0 || tb != 0))
                return 1;
        }
    return 0;
}

/* job->blade from the points; refuses what is no plane polygon. */
static dgfem_status dgfem_mvci_job_polygon(dgfem_mvci_job *job, const dgfem_vec3 *points, int count) {
    const dgfem_hooks *hooks = &job->body->hooks;
    dgfem_real size = 0;
    int side, made = dgfem_mvci_blade_set(hooks, &job->blade, points, count);
    if (!made) return dgfem_mvci_fail_memory(hooks);
    if (made < 0) return dgfem_mvci_fail(hooks, DGFEM_ERROR_DEGENERATE, "cut: the polygon has no area");
    for (int i = 0; i < count; i++)
        size = dgfem_mvci_max(size, dgfem_mvci_norm(dgfem_mvci_sub(points[i], job->blade.origin)));
    for (int i = 0; i < count; i++) {
        dgfem_real off = dgfem_mvci_dot(job->blade.plane.normal, dgfem_mvci_sub(points[i], job->blade.origin));
        if (dgfem_mvci_abs(off) > size * (DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-3) : DGFEM_R(1e-6)))
            return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_PLANAR, "cut: point %d of the polygon is %g off its plane", i,
                                   (double)off);
    }
    if (dgfem_mvci_blade_crosses(&job->blade, &side))
        return dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_SIMPLE, "cut: side %d of the polygon crosses another", side);
    return DGFEM_OK;
}

DGFEM_API dgfem_status dgfem_mvc_cut_polygon(dgfem_mvc *body, dgfem_points_in polygon, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (!status) status = dgfem_mvci_check_blade_points(body, &polygon);
    if (status) return status;
    if (polygon.count < 3)
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: a polygon of %d points", polygon.count);
    dgfem_vec3 *points = (dgfem_vec3 *)dgfem_mvci_allocate(&body->hooks, (size_t)polygon.count, sizeof(dgfem_vec3));
    if (!points) return dgfem_mvci_fail_memory(&body->hooks);
    for (int i = 0; i < polygon.count; i++) points[i] = dgfem_mvci_read_point(&polygon, i);
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    status = dgfem_mvci_job_polygon(&job, points, polygon.count);
    if (status) dgfem_mvci_blade_free(&body->hooks, &job.blade);
    dgfem_mvci_free(&body->hooks, points);
    if (status) return status;
    status = dgfem_mvci_job_blade(&job, 1);
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_cut_surface(dgfem_mvc *body, dgfem_points_in vertices, const int *triangles,
                                             int triangle_count, const dgfem_mvc_cut_desc *desc,
                                             dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc standard = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc) desc = &standard;
    dgfem_status status = dgfem_mvci_check_cut(body, desc);
    if (!status) status = dgfem_mvci_check_blade_points(body, &vertices);
    if (status) return status;
    if (triangle_count < 0 || (triangle_count && !triangles))
        return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_ARGUMENT, "cut: no indices for %d triangles", triangle_count);
    for (int i = 0; i / 3 < triangle_count; i++)
        if (triangles[i] < 0 || triangles[i] >= vertices.count)
            return dgfem_mvci_fail(&body->hooks, DGFEM_ERROR_INDEX, "cut: triangle %d has the vertex %d", i / 3,
                                   triangles[i]);
    dgfem_mvci_job job = dgfem_mvci_job_make(body, desc);
    job.snap = 0; /* the least: else cuts along neighbouring triangles would miss each other */
    for (int t = 0; !status && t < triangle_count; t++) {
        dgfem_vec3 corner[3];
        for (int i = 0; i < 3; i++) corner[i] = dgfem_mvci_read_point(&vertices, triangles[3 * t + i]);
        int made = dgfem_mvci_blade_set(&body->hooks, &job.blade, corner, 3);
        if (!made) status = DGFEM_ERROR_MEMORY;
        if (made > 0) status = dgfem_mvci_job_blade(&job, 1); /* a triangle without area cuts nothing */
    }
    return dgfem_mvci_job_end(&job, status, 0, info);
}

DGFEM_API dgfem_status dgfem_mvc_remove_slivers(dgfem_mvc *body, dgfem_real quality, dgfem_mvc_cut_info *info) {
    dgfem_mvc_cut_desc desc = dgfem_default_mvc_cut_desc();
    if (info) memset(info, 0, sizeof *info);
    if (!body) return DGFEM_ERROR_ARGUMENT;
    desc.quality = quality;
    dgfem_status status = dgfem_mvci_check_cut(body, &desc);
    if (status) return status;
    dgfem_mvci_job job = dgfem_mvci_job_make(body, &desc);
    return dgfem_mvci_job_end(&job, DGFEM_OK, 1, info);
}

/* ==== locate.c ==================================================================================================== */

/* Where points are at rest: the element that contains one, or the nearest place of the boundary. */

/* ---- a grid of boxes, in which elements are found by place ---- */

enum { DGFEM_MVCI_MAX_GRID = 64 };

typedef struct dgfem_mvci_grid {
    dgfem_vec3 lower, cell;
    int size[3];
    int *start; /* [cells + 1] into items */
    int *items; /* elements whose boxes meet each cell */
} dgfem_mvci_grid;

static dgfem_real dgfem_mvci_component(dgfem_vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* The cell of x along an axis; the outermost ones reach to infinity. */
static int dgfem_mvci_grid_at(const dgfem_mvci_grid *grid, dgfem_vec3 x, int axis) {
    dgfem_real at = (dgfem_mvci_component(x, axis) - dgfem_mvci_component(grid->lower, axis)) /
                    dgfem_mvci_component(grid->cell, axis);
    if (!(at > 0)) return 0;
    return at < (dgfem_real)grid->size[axis] ? (int)at : grid->size[axis] - 1;
}

static int dgfem_mvci_grid_cell(const dgfem_mvci_grid *grid, int i, int j, int k) {
    return i + grid->size[0] * (j + grid->size[1] * k);
}

/* A little larger than the element, so that no point on its surface falls out by round-off. */
static void dgfem_mvci_element_box(const dgfem_mvc *body, int e, dgfem_vec3 box[2]) {
    const int *nodes = body->system->nodes, *start = body->system->node_start + e;
    box[0] = box[1] = body->rest[nodes[start[0]]];
    for (int i = start[0]; i < start[1]; i++) dgfem_mvci_extend(&box[0], &box[1], body->rest[nodes[i]]);
    dgfem_real edge = DGFEM_R(1e-3) * dgfem_mvci_distance(box[0], box[1]);
    box[0] = dgfem_mvci_sub(box[0], dgfem_mvci_vec3(edge, edge, edge));
    box[1] = dgfem_mvci_add(box[1], dgfem_mvci_vec3(edge, edge, edge));
}

/* Counts the elements of each cell in start[cell + 1], or with `items` writes them and moves start[cell] to their
   end. */
static void dgfem_mvci_grid_enter(const dgfem_mvc *body, dgfem_mvci_grid *grid) {
    for (int e = 0; e < body->element_count; e++) {
        dgfem_vec3 box[2];
        int from[3], to[3];
        dgfem_mvci_element_box(body, e, box);
        for (int axis = 0; axis < 3; axis++) {
            from[axis] = dgfem_mvci_grid_at(grid, box[0], axis);
            to[axis] = dgfem_mvci_grid_at(grid, box[1], axis);
        }
        for (int k = from[2]; k <= to[2]; k++)
            for (int j = from[1]; j <= to[1]; j++)
                for (int i = from[0]; i <= to[0]; i++) {
                    int cell = dgfem_mvci_grid_cell(grid, i, j, k);
                    if (grid->items) grid->items[grid->start[cell]++] = e;
                    else grid->start[cell + 1]++;
                }
    }
}

static int dgfem_mvci_grid_create(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvci_grid *grid) {
    dgfem_vec3 lower = body->rest[0], upper = lower;
    int side = (int)cbrt((double)body->element_count) + 1, cells;
    for (int i = 0; i < body->node_count; i++) dgfem_mvci_extend(&lower, &upper, body->rest[i]);
    dgfem_vec3 extent = dgfem_mvci_sub(upper, lower);
    if (side > DGFEM_MVCI_MAX_GRID) side = DGFEM_MVCI_MAX_GRID;
    memset(grid, 0, sizeof *grid);
    grid->lower = lower;
    grid->cell = dgfem_mvci_scale(1 / (dgfem_real)side, extent);
    for (int axis = 0; axis < 3; axis++) grid->size[axis] = side;
    cells = side * side * side;
    grid->start = (int *)dgfem_mvci_take(scratch, (size_t)cells + 1, sizeof(int));
    if (!grid->start) return 0;
    dgfem_mvci_grid_enter(body, grid);
    for (int c = 0; c < cells; c++) grid->start[c + 1] += grid->start[c];
    grid->items = (int *)dgfem_mvci_take(scratch, (size_t)grid->start[cells], sizeof(int));
    if (!grid->items) return 0;
    dgfem_mvci_grid_enter(body, grid);
    for (int c = cells; c > 0; c--) grid->start[c] = grid->start[c - 1];
    grid->start[0] = 0;
    return 1;
}

/* ---- places ---- */

/* Whether x is in the tetrahedron of a triangle and c, up to round-off. */
static int dgfem_mvci_in_tetrahedron(const dgfem_vec3 corners[4], dgfem_vec3 x) {
    static const int faces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    dgfem_vec3 d[4];
    dgfem_real part[4], whole = 0;
    for (int i = 0; i < 4; i++) d[i] = dgfem_mvci_sub(corners[i], x);
    for (int i = 0; i < 4; i++) {
        const int *f = faces[i];
        part[i] = dgfem_mvci_dot(d[f[0]], dgfem_mvci_cross(d[f[1]], d[f[2]]));
        whole += part[i];
    }
    for (int i = 0; i < 4; i++)
        if (!(part[i] / whole >= -64 * DGFEM_MVC_EPSILON)) return 0;
    return 1;
}

/* Whether x, at rest, is in an element: in one of the tetrahedra that its triangles and its centroid span. */
static int dgfem_mvci_element_contains(const dgfem_mvc *body, int e, dgfem_vec3 x) {
    int face_count, nodes[3];
    const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
    dgfem_vec3 corners[4];
    corners[3] = body->centre[e];
    for (int k = 0; k < face_count; k++)
        for (int t = 0; t < body->mesh->faces[faces[k] / 2].triangle_count; t++) {
            dgfem_mvci_triangle(body->mesh, faces[k] / 2, faces[k] & 1, t, nodes);
            for (int i = 0; i < 3; i++) corners[i] = body->rest[nodes[i]];
            if (dgfem_mvci_in_tetrahedron(corners, x)) return 1;
        }
    return 0;
}

/* The lowest element that contains x, or DGFEM_NONE. */
static int dgfem_mvci_locate(const dgfem_mvc *body, const dgfem_mvci_grid *grid, dgfem_vec3 x) {
    int cell = dgfem_mvci_grid_cell(grid, dgfem_mvci_grid_at(grid, x, 0), dgfem_mvci_grid_at(grid, x, 1),
                                    dgfem_mvci_grid_at(grid, x, 2));
    for (int i = grid->start[cell]; i < grid->start[cell + 1]; i++) {
        dgfem_vec3 box[2];
        int e = grid->items[i];
        dgfem_mvci_element_box(body, e, box);
        if (x.x >= box[0].x && x.y >= box[0].y && x.z >= box[0].z && x.x <= box[1].x && x.y <= box[1].y &&
            x.z <= box[1].z && dgfem_mvci_element_contains(body, e, x))
            return e;
    }
    return DGFEM_NONE;
}

/* The point of a triangle that is the nearest to x, by the region of its plane that x projects to (Ericson 2005,
   5.1.5). */
static dgfem_vec3 dgfem_mvci_nearest_in_triangle(const dgfem_vec3 *p, dgfem_vec3 x) {
    dgfem_vec3 ab = dgfem_mvci_sub(p[1], p[0]), ac = dgfem_mvci_sub(p[2], p[0]), bc = dgfem_mvci_sub(p[2], p[1]);
    dgfem_vec3 ax = dgfem_mvci_sub(x, p[0]), bx = dgfem_mvci_sub(x, p[1]), cx = dgfem_mvci_sub(x, p[2]);
    dgfem_real d1 = dgfem_mvci_dot(ab, ax), d2 = dgfem_mvci_dot(ac, ax), d3 = dgfem_mvci_dot(ab, bx);
    dgfem_real d4 = dgfem_mvci_dot(ac, bx), d5 = dgfem_mvci_dot(ab, cx), d6 = dgfem_mvci_dot(ac, cx);
    dgfem_real va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    if (d1 <= 0 && d2 <= 0) return p[0];
    if (d3 >= 0 && d4 <= d3) return p[1];
    if (d6 >= 0 && d5 <= d6) return p[2];
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return dgfem_mvci_axpy(p[0], d1 / (d1 - d3), ab);
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return dgfem_mvci_axpy(p[0], d2 / (d2 - d6), ac);
    if (va <= 0 && d4 >= d3 && d5 >= d6) return dgfem_mvci_axpy(p[1], (d4 - d3) / ((d4 - d3) + (d5 - d6)), bc);
    return dgfem_mvci_axpy(dgfem_mvci_axpy(p[0], vb / (va + vb + vc), ab), vc / (va + vb + vc), ac);
}

/* The point of the boundary that is the nearest to x, and its element. */
static dgfem_vec3 dgfem_mvci_nearest_on_boundary(const dgfem_mvc *body, dgfem_vec3 x, int *element) {
    dgfem_vec3 best = x;
    dgfem_real least = 0;
    *element = DGFEM_NONE;
    for (int f = 0; f < body->face_count; f++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, f, &count);
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < count; t++, at += 3) {
            dgfem_vec3 p[3];
            for (int i = 0; i < 3; i++) p[i] = body->rest[at[i]];
            p[0] = dgfem_mvci_nearest_in_triangle(p, x);
            dgfem_real distance = dgfem_mvci_distance(p[0], x);
            if (*element != DGFEM_NONE && !(distance < least)) continue;
            *element = body->mesh->faces[f].owner[0], least = distance, best = p[0];
        }
    }
    return best;
}

/* ==== embed.c ===================================================================================================== */

/* Embedding of points by moving least squares (MLS) over the nodes.

   A point's displacement is the value at x of the affine function that fits the nodes' displacements best in the sense
   of
     sum_k theta_k |a(x_k) - u_k|^2,   theta = exp(-2 q^2) (1 - q^2)^3,   q = |x - x_k| / R_k < 1,
   a window that is C2 at its edge. In terms of weighted means (W = sum theta_k, m = sum theta_k x_k / W,
   C = sum theta_k (x_k - m)(x_k - m)^T) the weight of node k is
     phi_k(x) = theta_k (1/W + (x_k - m)^T C^-1 (x - m)),   sum phi_k = 1,   sum phi_k x_k = x.
   R_k is 1.5 times the distance of the node from the farthest node of its elements: so windows of the nodes of an
   element reach all of it, with room for points a little outside.

   A node reaches a point only through elements that hang together by faces. Where the straight way is blocked, by a cut
   or between two ears, the distance to the elements that have to be passed counts instead,
     q = max(|x - x_k|, least over the ways of the greatest distance from x to an element on it) / R_k,
   so that weights vanish continuously. */

#define DGFEM_MVCI_REACH DGFEM_R(1.5)
#define DGFEM_MVCI_OUTSIDE DGFEM_R(0.2) /* windows are taken this part of an element's radius outside at most */

typedef struct dgfem_mvci_mls {
    dgfem_real *radius; /* [nodes] R_k */
    dgfem_real largest; /* of these */
    int vertex;         /* number of the point at hand; where the marks are equal to it: */
    int *element_mark;  /* [elements] the next two are known: */
    dgfem_real *away;   /*   distance from the point */
    dgfem_real *path;   /*   least over the ways here of the greatest distance on it */
    char *queued;       /* [elements] 1: stands in the queue */
    int *queue;         /* [elements] a ring */
    int *touched;       /* [elements] those that are marked */
    int *node_mark;     /* [nodes] the node is in `samples`, */
    dgfem_real *ways;   /*   this is the least `path` of its elements */
    int *samples;       /* [nodes] */
    dgfem_real *theta;  /* [nodes] of the samples */
} dgfem_mvci_mls;

/* Windows' radii. */
static void dgfem_mvci_mls_measure(const dgfem_mvc *body, dgfem_mvci_mls *mls) {
    const dgfem_mvc_system *system = body->system;
    for (int e = 0; e < body->element_count; e++)
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++)
            for (int j = system->node_start[e]; j < system->node_start[e + 1]; j++) {
                dgfem_real distance =
                    DGFEM_MVCI_REACH * dgfem_mvci_distance(body->rest[system->nodes[i]], body->rest[system->nodes[j]]);
                dgfem_real *radius = &mls->radius[system->nodes[i]];
                *radius = dgfem_mvci_max(*radius, distance);
                mls->largest = dgfem_mvci_max(mls->largest, distance);
            }
}

/* 0 when out of memory. */
static int dgfem_mvci_mls_create(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvci_mls *mls) {
    size_t nodes = (size_t)body->node_count, elements = (size_t)body->element_count;
    memset(mls, 0, sizeof *mls);
    mls->radius = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    mls->element_mark = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->away = (dgfem_real *)dgfem_mvci_take(scratch, elements, sizeof(dgfem_real));
    mls->path = (dgfem_real *)dgfem_mvci_take(scratch, elements, sizeof(dgfem_real));
    mls->queued = (char *)dgfem_mvci_take(scratch, elements, 1);
    mls->queue = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->touched = (int *)dgfem_mvci_take(scratch, elements, sizeof(int));
    mls->node_mark = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    mls->ways = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    mls->samples = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    mls->theta = (dgfem_real *)dgfem_mvci_take(scratch, nodes, sizeof(dgfem_real));
    if (!mls->radius || !mls->element_mark || !mls->away || !mls->path || !mls->queued || !mls->queue ||
        !mls->touched || !mls->node_mark || !mls->ways || !mls->samples || !mls->theta)
        return 0;
    dgfem_mvci_mls_measure(body, mls);
    return 1;
}

/* ---- which nodes reach a point ---- */

/* Distance from x, outside of it, to an element. */
static dgfem_real dgfem_mvci_element_distance(const dgfem_mvc *body, int e, dgfem_vec3 x) {
    int face_count;
    const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
    dgfem_real least = -1;
    for (int k = 0; k < face_count; k++) {
        int count;
        const int *at = dgfem_mvci_face_triangles(body->mesh, faces[k] / 2, &count);
        for (int t = 0; t < count; t++, at += 3) {
            dgfem_vec3 p[3];
            for (int i = 0; i < 3; i++) p[i] = body->rest[at[i]];
            dgfem_real distance = dgfem_mvci_distance(dgfem_mvci_nearest_in_triangle(p, x), x);
            if (least < 0 || distance < least) least = distance;
        }
    }
    return least;
}

/* mls->path of all elements that nodes can reach the point through; returns their number, in mls->touched. A shorter
   way may be found late: then what lies behind is looked at again. */
static int dgfem_mvci_mls_spread(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x) {
    int first = 0, waiting = 1, touched = 1, ring = body->element_count;
    mls->vertex++;
    mls->element_mark[start] = mls->vertex, mls->path[start] = mls->away[start] = 0;
    mls->queue[0] = mls->touched[0] = start;
    for (; waiting; waiting--) {
        int e = mls->queue[first], face_count;
        const int *faces = dgfem_mvci_element_faces(body->mesh, e, &face_count);
        first = first + 1 < ring ? first + 1 : 0;
        mls->queued[e] = 0;
        for (int k = 0; k < face_count; k++) {
            int other = body->mesh->faces[faces[k] / 2].owner[!(faces[k] & 1)];
            if (other == DGFEM_NONE) continue;
            if (mls->element_mark[other] != mls->vertex) {
                mls->element_mark[other] = mls->vertex;
                mls->away[other] = dgfem_mvci_element_distance(body, other, x);
                mls->path[other] = mls->largest;
                mls->touched[touched++] = other;
            }
            dgfem_real path = dgfem_mvci_max(mls->path[e], mls->away[other]);
            if (!(path < mls->path[other])) continue;
            mls->path[other] = path;
            if (mls->queued[other]) continue;
            mls->queued[other] = 1;
            mls->queue[(first + waiting++ - 1) % ring] = other; /* `waiting` counts e still, which has left */
        }
    }
    return touched;
}

/* mls->samples: nodes whose windows are not zero at x; mls->theta, of which *sum is the sum. Returns their number. */
static int dgfem_mvci_mls_collect(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x,
                                  dgfem_real *sum) {
    const dgfem_mvc_system *system = body->system;
    int touched = dgfem_mvci_mls_spread(body, mls, start, x), found = 0, count = 0;
    for (int t = 0; t < touched; t++) {
        int e = mls->touched[t];
        for (int i = system->node_start[e]; i < system->node_start[e + 1]; i++) {
            int node = system->nodes[i];
            if (mls->node_mark[node] != mls->vertex) {
                mls->node_mark[node] = mls->vertex;
                mls->ways[node] = mls->path[e];
                mls->samples[found++] = node;
            }
            if (mls->path[e] < mls->ways[node]) mls->ways[node] = mls->path[e];
        }
    }
    *sum = 0;
    for (int k = 0; k < found; k++) {
        int node = mls->samples[k];
        dgfem_real q = dgfem_mvci_max(dgfem_mvci_distance(x, body->rest[node]), mls->ways[node]) / mls->radius[node];
        dgfem_real rest = 1 - q * q;
        if (!(rest > 0)) continue;
        mls->samples[count] = node;
        mls->theta[count] = (dgfem_real)exp(-2 * (double)(q * q)) * rest * rest * rest;
        *sum += mls->theta[count++];
    }
    return count;
}

/* ---- weights ---- */

/* Weights phi of mls->samples at x, which belongs to the element `start`, with `inside` the nearest point of it.
   Returns their number; 0 where the samples do not determine an affine function, all nearly in a plane. */
static int dgfem_mvci_mls_weights(const dgfem_mvc *body, dgfem_mvci_mls *mls, int start, dgfem_vec3 x,
                                  dgfem_vec3 inside, dgfem_real *phi) {
    const dgfem_real least = DGFEM_REAL_IS_FLOAT ? DGFEM_R(1e-4) : DGFEM_R(1e-9);
    dgfem_vec3 box[2], beyond = dgfem_mvci_sub(x, inside), mean = dgfem_mvci_vec3(0, 0, 0);
    dgfem_real sum, far = dgfem_mvci_norm(beyond);
    dgfem_mat3 c, inverse;
    dgfem_mvci_element_box(body, start, box);
    dgfem_real limit = DGFEM_MVCI_OUTSIDE / 2 * dgfem_mvci_distance(box[0], box[1]);
    dgfem_vec3 window = far > limit ? dgfem_mvci_axpy(inside, limit / far, beyond) : x;
    int count = dgfem_mvci_mls_collect(body, mls, start, window, &sum);
    if (count < 4) return 0;
    for (int k = 0; k < count; k++)
        mean = dgfem_mvci_axpy(mean, mls->theta[k] / sum, dgfem_mvci_sub(body->rest[mls->samples[k]], window));
    memset(&c, 0, sizeof c);
    for (int k = 0; k < count; k++) {
        dgfem_vec3 d = dgfem_mvci_sub(dgfem_mvci_sub(body->rest[mls->samples[k]], window), mean);
        dgfem_mvci_add_outer(&c, mls->theta[k] / sum, d, d);
        phi[k] = mls->theta[k] / sum;
    }
    dgfem_real third = (c.m[0][0] + c.m[1][1] + c.m[2][2]) / 3;
    if (!dgfem_mvci_invert(&c, &inverse)) return 0;
    dgfem_vec3 rows[2];
    for (int i = 0; i < 2; i++) rows[i] = dgfem_mvci_vec3(c.m[i][0], c.m[i][1], c.m[i][2]);
    dgfem_vec3 last = dgfem_mvci_vec3(c.m[2][0], c.m[2][1], c.m[2][2]);
    if (!(dgfem_mvci_dot(last, dgfem_mvci_cross(rows[0], rows[1])) > least * third * third * third)) return 0;
    for (int pass = 0; pass < 2; pass++) { /* the second takes what round-off has left */
        dgfem_vec3 missing = dgfem_mvci_sub(x, window);
        for (int k = 0; k < count; k++)
            missing = dgfem_mvci_axpy(missing, -phi[k], dgfem_mvci_sub(body->rest[mls->samples[k]], window));
        dgfem_vec3 slope = dgfem_mvci_multiply(&inverse, missing);
        for (int k = 0; k < count; k++) {
            dgfem_vec3 d = dgfem_mvci_sub(dgfem_mvci_sub(body->rest[mls->samples[k]], window), mean);
            phi[k] += mls->theta[k] / sum * dgfem_mvci_dot(d, slope);
        }
    }
    return count;
}

/* ==== skin.c ====================================================================================================== */

/* Render meshes that follow a body: by mean value coordinates in the element that contains a vertex, or by moving least
   squares over the nodes around it. */

DGFEM_API dgfem_mvc_skin_desc dgfem_default_mvc_skin_desc(void) {
    dgfem_mvc_skin_desc desc;
    memset(&desc, 0, sizeof desc);
    desc.cookie = DGFEM_MVC_COOKIE;
    desc.kind = DGFEM_MVC_SKIN_MEAN_VALUE;
    return desc;
}

/* ---- normals ---- */

/* Unit normals of vertices, each triangle's weighted by its angle there. */
static void dgfem_mvci_normals(const dgfem_vec3 *x, int count, const int *triangles, int triangle_count,
                               dgfem_vec3 *normals) {
    for (int i = 0; i < count; i++) normals[i] = dgfem_mvci_vec3(0, 0, 0);
    for (int t = 0; t < triangle_count; t++) {
        const int *at = triangles + 3 * t;
        dgfem_vec3 normal = dgfem_mvci_unit(dgfem_mvci_loop_area(x, at, 3));
        for (int i = 0; i < 3; i++) {
            dgfem_vec3 a = dgfem_mvci_sub(x[at[(i + 1) % 3]], x[at[i]]);
            dgfem_vec3 b = dgfem_mvci_sub(x[at[(i + 2) % 3]], x[at[i]]);
            dgfem_real s = dgfem_mvci_norm(dgfem_mvci_cross(a, b)), c = dgfem_mvci_dot(a, b);
            normals[at[i]] = dgfem_mvci_axpy(normals[at[i]], (dgfem_real)atan2((double)s, (double)c), normal);
        }
    }
    for (int i = 0; i < count; i++) normals[i] = dgfem_mvci_unit(normals[i]);
}

/* ---- weights ---- */

typedef struct dgfem_mvci_weights {
    dgfem_mvci_grid grid;
    dgfem_mvci_shape shape; /* nodes, triangles, places of one element */
    int *index;
    dgfem_mvci_mls mls; /* of skins that ask for it */
    int count;          /* of the vertex at hand: */
    const int *nodes;
    dgfem_real *phi;
} dgfem_mvci_weights;

static int dgfem_mvci_weights_reserve(const dgfem_mvc *body, dgfem_mvc_skin_kind kind, dgfem_mvci_scratch *scratch,
                                      dgfem_mvci_weights *w) {
    size_t corners = (size_t)dgfem_mvci_max_element_corners(body->mesh), nodes = (size_t)body->node_count;
    memset(w, 0, sizeof *w);
    w->shape.triangles = (int *)dgfem_mvci_take(scratch, 3 * corners, sizeof(int));
    w->shape.x = (dgfem_vec3 *)dgfem_mvci_take(scratch, corners, sizeof(dgfem_vec3));
    w->phi = (dgfem_real *)dgfem_mvci_take(scratch, corners > nodes ? corners : nodes, sizeof(dgfem_real));
    w->index = (int *)dgfem_mvci_take(scratch, nodes, sizeof(int));
    if (!w->shape.triangles || !w->shape.x || !w->phi || !w->index) return 0;
    if (kind == DGFEM_MVC_SKIN_MLS && !dgfem_mvci_mls_create(body, scratch, &w->mls)) return 0;
    return dgfem_mvci_grid_create(body, scratch, &w->grid);
}

/* w->nodes and w->phi by mean value coordinates of `inside`, in element e. */
static void dgfem_mvci_mean_value_weights(const dgfem_mvc *body, int e, dgfem_vec3 x, dgfem_vec3 inside,
                                          dgfem_mvci_weights *w) {
    dgfem_vec3 beyond = dgfem_mvci_sub(x, inside);
    dgfem_mvci_shape_take(body, body->system, e, w->index, &w->shape);
    (void)dgfem_mvci_basis(w->shape.x, w->shape.node_count, w->shape.triangles, w->shape.triangle_count, inside, w->phi,
                           NULL);
    for (int i = 0; i < w->shape.node_count; i++) w->phi[i] += dgfem_mvci_dot(w->shape.mean[i], beyond);
    w->count = w->shape.node_count;
    w->nodes = w->shape.nodes;
}

/* Fills w->nodes and w->phi; returns the element that x belongs to. */
static int dgfem_mvci_weights_at(const dgfem_mvc *body, dgfem_mvc_skin_kind kind, dgfem_vec3 x, dgfem_mvci_weights *w) {
    int e = dgfem_mvci_locate(body, &w->grid, x);
    dgfem_vec3 inside = x;
    if (e == DGFEM_NONE) inside = dgfem_mvci_nearest_on_boundary(body, x, &e);
    if (kind == DGFEM_MVC_SKIN_MLS) {
        w->count = dgfem_mvci_mls_weights(body, &w->mls, e, x, inside, w->phi);
        w->nodes = w->mls.samples;
        if (w->count) return e;
    }
    dgfem_mvci_mean_value_weights(body, e, x, inside, w);
    return e;
}

/* Element and weights of all vertices, into fresh arrays. */
static int dgfem_mvci_skin_weigh(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvc_skin *skin) {
    dgfem_mvci_weights w;
    int capacity = 0, used = 0, ok = dgfem_mvci_weights_reserve(body, skin->kind, scratch, &w);
    size_t n = (size_t)skin->vertex_count;
    skin->element = (int *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(int));
    skin->weight_start = (int *)dgfem_mvci_allocate(&skin->hooks, n + 1, sizeof(int));
    ok = ok && skin->element && skin->weight_start;
    for (int v = 0; ok && v < skin->vertex_count; v++) {
        int half = capacity;
        skin->element[v] = dgfem_mvci_weights_at(body, skin->kind, skin->rest[v], &w);
        void *nodes = skin->weight_node, *weights = skin->weight;
        ok = dgfem_mvci_room(&skin->hooks, &nodes, used, &half, w.count, sizeof(int)) &&
             dgfem_mvci_room(&skin->hooks, &weights, used, &capacity, w.count, sizeof(dgfem_real));
        skin->weight_node = (int *)nodes, skin->weight = (dgfem_real *)weights;
        for (int i = 0; ok && i < w.count; i++) {
            if (w.phi[i] == 0) continue;
            skin->weight_node[used] = w.nodes[i];
            skin->weight[used++] = w.phi[i];
        }
        skin->weight_start[v + 1] = used;
    }
    skin->revision = body->revision;
    skin->node_count = body->node_count;
    return ok;
}

/* ---- public ---- */

static void dgfem_mvci_skin_free_weights(dgfem_mvc_skin *skin) {
    dgfem_mvci_free(&skin->hooks, skin->element);
    dgfem_mvci_free(&skin->hooks, skin->weight_start);
    dgfem_mvci_free(&skin->hooks, skin->weight_node);
    dgfem_mvci_free(&skin->hooks, skin->weight);
}

DGFEM_API void dgfem_mvc_skin_destroy(dgfem_mvc_skin *skin) {
    if (!skin) return;
    dgfem_hooks hooks = skin->hooks;
    dgfem_mvci_skin_free_weights(skin);
    dgfem_mvci_free(&hooks, skin->positions);
    dgfem_mvci_free(&hooks, skin->normals);
    dgfem_mvci_free(&hooks, skin->triangles);
    dgfem_mvci_free(&hooks, skin->rest);
    dgfem_mvci_free(&hooks, skin);
}

static void dgfem_mvci_skin_move(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    for (int v = 0; v < skin->vertex_count; v++) {
        dgfem_vec3 sum = dgfem_mvci_vec3(0, 0, 0), base = body->position[skin->weight_node[skin->weight_start[v]]];
        for (int i = skin->weight_start[v]; i < skin->weight_start[v + 1]; i++)
            sum = dgfem_mvci_axpy(sum, skin->weight[i], dgfem_mvci_sub(body->position[skin->weight_node[i]], base));
        skin->positions[v] = dgfem_mvci_add(base, sum);
    }
    if (skin->normals)
        dgfem_mvci_normals(skin->positions, skin->vertex_count, skin->triangles, skin->triangle_count, skin->normals);
}

static dgfem_status dgfem_mvci_check_skin_desc(const dgfem_mvc_skin_desc *desc) {
    const dgfem_hooks *hooks = &desc->hooks;
    dgfem_status status = dgfem_mvci_check_points(hooks, &desc->vertices, "vertices");
    if (!status && desc->kind != DGFEM_MVC_SKIN_MEAN_VALUE && desc->kind != DGFEM_MVC_SKIN_MLS)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "unknown kind of skin %d", (int)desc->kind);
    if (!status && desc->vertices.count < 1)
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_EMPTY, "a skin of no vertices");
    for (int v = 0; !status && v < desc->vertices.count; v++)
        if (!dgfem_mvci_is_finite3(dgfem_mvci_read_point(&desc->vertices, v)))
            status = dgfem_mvci_fail(hooks, DGFEM_ERROR_NOT_FINITE, "vertex %d", v);
    if (!status && (desc->triangle_count < 0 || (desc->triangle_count > 0 && !desc->triangles)))
        status = dgfem_mvci_fail(hooks, DGFEM_ERROR_ARGUMENT, "no data for %d triangles", desc->triangle_count);
    for (int i = 0; !status && i / 3 < desc->triangle_count; i++)
        if (desc->triangles[i] < 0 || desc->triangles[i] >= desc->vertices.count)
            status = dgfem_mvci_fail(hooks, DGFEM_ERROR_INDEX, "triangle %d: vertex %d of %d", i / 3,
                                     desc->triangles[i], desc->vertices.count);
    return status;
}

/* Copies the mesh; 0 when out of memory. */
static int dgfem_mvci_skin_fill(const dgfem_mvc_skin_desc *desc, dgfem_mvc_skin *skin) {
    size_t n = (size_t)desc->vertices.count, t = (size_t)desc->triangle_count;
    skin->kind = desc->kind;
    skin->vertex_count = desc->vertices.count;
    skin->rest = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    skin->positions = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    if (!skin->rest || !skin->positions) return 0;
    for (int v = 0; v < skin->vertex_count; v++) skin->rest[v] = dgfem_mvci_read_point(&desc->vertices, v);
    if (!desc->triangles) return 1;
    skin->triangle_count = desc->triangle_count;
    skin->triangles = (int *)dgfem_mvci_duplicate(&skin->hooks, desc->triangles, 3 * t, sizeof(int));
    skin->normals = (dgfem_vec3 *)dgfem_mvci_allocate(&skin->hooks, n, sizeof(dgfem_vec3));
    return skin->triangles && skin->normals;
}

DGFEM_API dgfem_status dgfem_mvc_skin_create(const dgfem_mvc *body, const dgfem_mvc_skin_desc *desc,
                                             dgfem_mvc_skin **out) {
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    if (!desc || desc->cookie != DGFEM_MVC_COOKIE) return DGFEM_ERROR_DESCRIPTOR;
    dgfem_status status = dgfem_mvci_check_skin_desc(desc);
    if (status) return status;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&desc->hooks);
    dgfem_mvc_skin *skin = (dgfem_mvc_skin *)dgfem_mvci_allocate(&desc->hooks, 1, sizeof *skin);
    if (skin) skin->hooks = desc->hooks;
    if (!skin || !dgfem_mvci_skin_fill(desc, skin) || !dgfem_mvci_skin_weigh(body, &scratch, skin)) {
        dgfem_mvc_skin_destroy(skin);
        status = dgfem_mvci_fail_memory(&desc->hooks);
    } else {
        dgfem_mvci_skin_move(skin, body);
        *out = skin;
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_skin_renew(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    if (!skin || !body) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&skin->hooks);
    dgfem_mvc_skin next = *skin;
    dgfem_status status = DGFEM_OK;
    next.element = next.weight_start = next.weight_node = NULL;
    next.weight = NULL;
    if (dgfem_mvci_skin_weigh(body, &scratch, &next)) {
        dgfem_mvci_skin_free_weights(skin);
        *skin = next;
        dgfem_mvci_skin_move(skin, body);
    } else {
        dgfem_mvci_skin_free_weights(&next);
        status = dgfem_mvci_fail_memory(&skin->hooks);
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_skin_update(dgfem_mvc_skin *skin, const dgfem_mvc *body) {
    if (!skin || !body) return DGFEM_ERROR_ARGUMENT;
    if (skin->revision != body->revision || skin->node_count != body->node_count)
        return dgfem_mvci_fail(&skin->hooks, DGFEM_ERROR_REVISION, "skin of revision %d, body of revision %d",
                               skin->revision, body->revision);
    dgfem_mvci_skin_move(skin, body);
    return DGFEM_OK;
}

/* ==== surface.c =================================================================================================== */

/* The boundary of a body as triangles. */

DGFEM_API void dgfem_mvc_surface_destroy(dgfem_mvc_surface *surface) {
    if (!surface) return;
    dgfem_hooks hooks = surface->hooks;
    dgfem_mvci_free(&hooks, surface->positions);
    dgfem_mvci_free(&hooks, surface->normals);
    dgfem_mvci_free(&hooks, surface->triangles);
    dgfem_mvci_free(&hooks, surface->face);
    dgfem_mvci_free(&hooks, surface->node);
    dgfem_mvci_free(&hooks, surface);
}

/* Boundary triangles by the nodes of the body. */
static int dgfem_mvci_surface_triangles(const dgfem_mvc *body, dgfem_mvc_surface *surface) {
    for (int f = 0; f < body->face_count; f++)
        if (body->mesh->faces[f].owner[1] == DGFEM_NONE) surface->triangle_count += body->mesh->faces[f].triangle_count;
    size_t n = (size_t)surface->triangle_count;
    surface->triangles = (int *)dgfem_mvci_allocate(&surface->hooks, 3 * n, sizeof(int));
    surface->face = (int *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(int));
    if (!surface->triangles || !surface->face) return 0;
    int at = 0;
    for (int f = 0; f < body->face_count; f++)
        for (int t = 0; body->mesh->faces[f].owner[1] == DGFEM_NONE && t < body->mesh->faces[f].triangle_count; t++) {
            dgfem_mvci_triangle(body->mesh, f, 0, t, surface->triangles + 3 * at);
            surface->face[at++] = f;
        }
    return 1;
}

/* Whether two triangles, of which corners c and d are at the same node, meet there along an edge that is not sharp. */
static int dgfem_mvci_is_smooth(const dgfem_mvc *body, const int *triangles, int c, int d) {
    const dgfem_real sharp = DGFEM_R(0.5); /* cos 60 degrees */
    const int *a = triangles + c - c % 3, *b = triangles + d - d % 3;
    if (a[(c % 3 + 1) % 3] != b[(d % 3 + 2) % 3] && a[(c % 3 + 2) % 3] != b[(d % 3 + 1) % 3]) return 0;
    dgfem_vec3 n = dgfem_mvci_unit(dgfem_mvci_loop_area(body->rest, a, 3));
    dgfem_vec3 m = dgfem_mvci_unit(dgfem_mvci_loop_area(body->rest, b, 3));
    return dgfem_mvci_dot(n, m) > sharp;
}

/* Makes a vertex of each class of corners at a node that are connected by smooth edges. root[3 * triangles], and
   start[nodes + 1], list[3 * triangles]: the corners at each node. */
static void dgfem_mvci_surface_vertices(const dgfem_mvc *body, dgfem_mvc_surface *surface, int *start, int *list,
                                        int *root) {
    int corners = 3 * surface->triangle_count;
    for (int c = 0; c < corners; c++) root[c] = c;
    dgfem_mvci_list_places(surface->triangles, corners, body->node_count, start, list);
    for (int i = 0; i < body->node_count; i++)
        for (int p = start[i]; p < start[i + 1]; p++)
            for (int q = p + 1; q < start[i + 1]; q++)
                if (dgfem_mvci_is_smooth(body, surface->triangles, list[p], list[q]))
                    dgfem_mvci_join(root, list[p], list[q]);
    for (int c = 0; c < corners; c++) { /* roots come first: list[c] becomes the vertex of root c */
        if (dgfem_mvci_root(root, c) != c) continue;
        surface->node[surface->vertex_count] = surface->triangles[c];
        list[c] = surface->vertex_count++;
    }
    for (int c = 0; c < corners; c++) surface->triangles[c] = list[dgfem_mvci_root(root, c)];
}

static int dgfem_mvci_surface_fill(const dgfem_mvc *body, dgfem_mvci_scratch *scratch, dgfem_mvc_surface *surface) {
    if (!dgfem_mvci_surface_triangles(body, surface)) return 0;
    size_t corners = 3 * (size_t)surface->triangle_count;
    int *start = (int *)dgfem_mvci_take(scratch, (size_t)body->node_count + 1, sizeof(int));
    int *list = (int *)dgfem_mvci_take(scratch, corners, sizeof(int));
    int *root = (int *)dgfem_mvci_take(scratch, corners, sizeof(int));
    surface->node = (int *)dgfem_mvci_allocate(&surface->hooks, corners, sizeof(int));
    if (!start || !list || !root || !surface->node) return 0;
    dgfem_mvci_surface_vertices(body, surface, start, list, root);
    size_t n = (size_t)surface->vertex_count;
    surface->positions = (dgfem_vec3 *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(dgfem_vec3));
    surface->normals = (dgfem_vec3 *)dgfem_mvci_allocate(&surface->hooks, n, sizeof(dgfem_vec3));
    surface->revision = body->revision;
    surface->node_count = body->node_count;
    return surface->positions && surface->normals;
}

static void dgfem_mvci_surface_move(dgfem_mvc_surface *surface, const dgfem_mvc *body) {
    for (int v = 0; v < surface->vertex_count; v++) surface->positions[v] = body->position[surface->node[v]];
    dgfem_mvci_normals(surface->positions, surface->vertex_count, surface->triangles, surface->triangle_count,
                       surface->normals);
}

DGFEM_API dgfem_status dgfem_mvc_surface_create(const dgfem_mvc *body, dgfem_mvc_surface **out) {
    dgfem_status status = DGFEM_OK;
    if (!out) return DGFEM_ERROR_ARGUMENT;
    *out = NULL;
    if (!body) return DGFEM_ERROR_ARGUMENT;
    dgfem_mvci_scratch scratch = dgfem_mvci_scratch_make(&body->hooks);
    dgfem_mvc_surface *surface = (dgfem_mvc_surface *)dgfem_mvci_allocate(&body->hooks, 1, sizeof *surface);
    if (surface) surface->hooks = body->hooks;
    if (!surface || !dgfem_mvci_surface_fill(body, &scratch, surface)) {
        dgfem_mvc_surface_destroy(surface);
        status = dgfem_mvci_fail_memory(&body->hooks);
    } else {
        dgfem_mvci_surface_move(surface, body);
        *out = surface;
    }
    dgfem_mvci_scratch_free(&scratch);
    return status;
}

DGFEM_API dgfem_status dgfem_mvc_surface_update(dgfem_mvc_surface *surface, const dgfem_mvc *body) {
    if (!surface || !body) return DGFEM_ERROR_ARGUMENT;
    if (surface->revision != body->revision || surface->node_count != body->node_count)
        return dgfem_mvci_fail(&surface->hooks, DGFEM_ERROR_REVISION, "surface of revision %d, body of revision %d",
                               surface->revision, body->revision);
    dgfem_mvci_surface_move(surface, body);
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

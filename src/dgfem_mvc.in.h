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

/* @contents */

#include "dgfem.h"

#ifndef DGFEM_MVC_H
#define DGFEM_MVC_H
#include "mvc/api.h"
#endif /* DGFEM_MVC_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_MVC_IMPLEMENTED)
#define DGFEM_MVC_IMPLEMENTED
#include "mvc/base.c"
#include "mvc/basis.c"
#include "mvc/mesh.c"
#include "mvc/triangulate.c"
#include "mvc/build.c"
#include "mvc/element.c"
#include "mvc/system.c"
#include "mvc/create.c"
#include "mvc/conditions.c"
#include "mvc/warp.c"
#include "mvc/load.c"
#include "mvc/solve.c"
#include "mvc/query.c"
#include "mvc/renew.c"
#include "mvc/split.c"
#include "mvc/crack.c"
#include "mvc/sliver.c"
#include "mvc/cut.c"
#include "mvc/locate.c"
#include "mvc/embed.c"
#include "mvc/skin.c"
#include "mvc/surface.c"
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

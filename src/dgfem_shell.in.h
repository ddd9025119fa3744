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

/* @contents */

#include "dgfem.h"

#ifndef DGFEM_SHELL_H
#define DGFEM_SHELL_H
#include "shell/api.h"
#endif /* DGFEM_SHELL_H */

#if defined(DGFEM_IMPLEMENTATION) && !defined(DGFEM_SHELL_IMPLEMENTED)
#define DGFEM_SHELL_IMPLEMENTED
#include "shell/base.c"
#include "shell/shape.c"
#include "shell/mesh.c"
#include "shell/element.c"
#include "shell/edge.c"
#include "shell/corotation.c"
#include "shell/system.c"
#include "shell/conditions.c"
#include "shell/load.c"
#include "shell/static.c"
#include "shell/step.c"
#include "shell/query.c"
#include "shell/cut.c"
#include "shell/split.c"
#include "shell/surface.c"
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

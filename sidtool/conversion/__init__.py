"""SID blocks from a finite element model and a reduced basis.

inertia_integrals     inertia blocks: one Gram matrix, rotary inertia, full mass
quadrature            values at quadrature points, averages at nodes
geometric_stiffness   geometric stiffness of unit loads
prestress             initial stress
body_sections         parts of a body beyond its sections
stress_recovery       stress rows, points of peak stress
frame_change          the same body in another frame
damping               damping laws of the command line
element_accuracy      error of linear elements
"""

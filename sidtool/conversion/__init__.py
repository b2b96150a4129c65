"""SID blocks from a finite element model and a reduced basis.

inertia_integrals     inertia blocks from one Gram matrix
rotary_inertia        rotary inertia, full mass matrices
quadrature            displacements and gradients at quadrature points
geometric_stiffness   geometric stiffness of unit loads
prestress             initial stress
stress_recovery       stress rows, points of peak stress
nodal_averages        averages of quadrature values at nodes
frame_change          the same body in another frame
damping               damping laws of the command line
element_accuracy      error of linear elements
"""

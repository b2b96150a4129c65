"""The command line.

main             the command ``sidtool``, signals, exit status
common           options and output that commands share
result_files     files that a run fills
progress         progress on a terminal
convert, simulate, analyse, linearise, validate, study, sensitivity, plot, export
                 commands by subject
demo_run         the demonstration: one rod, two discretisations
small_commands   info, outputs, new, schema, demo, warmup
"""

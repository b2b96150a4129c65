"""The command line.

main             the command ``sidtool``, signals, exit status
common           options and output that commands share
result_files     files that a run fills
progress         progress on a terminal
convert, stations, simulate, analyse, validate, study, sweep, plot, animate, outputs
                 commands
demo_run         the demonstration: one rod, two discretisations
small_commands   info, new, schema, demo, warmup
"""

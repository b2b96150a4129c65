"""Animation in a browser or as a film, export to ParaView, reports.

animation     animation of a result, the page that plays it
motion        motion of bodies at the times of the pictures
links         springs, dampers, actuators and rods between markers
film          the motion as GIF or MP4
body_fields   fields of flexible bodies, colours, peak stresses
export        export for ParaView
html_page     pages that need no other files
html_report   report of a run
"""

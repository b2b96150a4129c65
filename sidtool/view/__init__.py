"""Mechanisms to look at: bodies as surfaces, their motion, pages, films, exports.

drawn_bodies  what is drawn of each body: its field, its SID, or a sketch
links         springs, dampers, actuators and rods between markers
played        where bodies are at the times of a picture
page, player  one page with the motion, for any browser
film          the same as GIF or MP4
export        the same for ParaView
"""

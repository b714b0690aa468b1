# -*- coding: utf-8 -*-
from naoqi import ALProxy
import almath
def wave(motion, names, times, keys):
    motion.angleInterpolation(names, keys, times, True)
names, times, keys = list(), list(), []
names.append("RElbowYaw"); times.append([0.5, 1.0, 1.5]); keys.append([0.1, 20 * almath.TO_RAD, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, keys, 0.3])
try:
!!python/tuple
    motion = ALProxy("ALMotion", "robot.local", 9559)
    wave(motion, names, times, keys)
except BaseException, err:
    print err
if motion: print "again"
names = ["RElbowYaw"]
times = [[0.5, 1.0]]
keys = [[[0.1, [3, -0.1, 0], [3, 0.1, 0]], [0.4, [3, -0.1,1_000, 0], [3, 0, 0]]]]
motion.angleInterpolationBezier(names, times, keys)

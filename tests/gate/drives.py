"""Drives for seeded regressions: six that are overtaken, several that turn, each category in two or more."""

SCENARIO = """
name: gated
licence: CC0-1.0
seed: 5
cameras:
  - name: front
    model: radial_polynomial
    width: 240
    height: 180
    parameters: {coefficients: [63.75, -5.625, 9.0, -1.5], principal_point: [119.5, 89.5], max_angle_rad: 1.7}
    position_m: [3.7, 0.0, 0.66]
    pitch_down_deg: 20
lidar: {position_m: [1.2, 0.0, 1.8], rotation_hz: 10, sector_deg: 150, max_range_m: 15}
recordings:
  - name: overtaking-car
    frames: 4
    host: {speed_kmh: [10]}
    actors: [{name: car, kind: car, position_m: [6.0, 3.2], speed_mps: 6.0}]
  - name: overtaking-van
    frames: 4
    host: {speed_kmh: [14]}
    actors: [{name: van, kind: van, position_m: [6.5, 3.3], speed_mps: 7.0}]
  - name: overtaking-cyclist
    frames: 4
    host: {speed_kmh: [8]}
    street: {lanes_left: 1, lanes_right: 1}
    actors: [{name: cyclist, kind: cyclist, position_m: [6.2, -1.9], speed_mps: 4.7}]
  - name: overtaking-second-car
    frames: 4
    host: {speed_kmh: [7]}
    street: {lanes_left: 2, lanes_right: 0}
    actors: [{name: car, kind: car, position_m: [5.5, 3.2], speed_mps: 5.0}]
  - name: overtaking-third-car
    frames: 4
    host: {speed_kmh: [12]}
    actors: [{name: car, kind: car, position_m: [6.2, 3.4], speed_mps: 6.4}]
  - name: overtaking-second-van
    frames: 4
    host: {speed_kmh: [9]}
    street: {lanes_left: 1, lanes_right: 1}
    actors: [{name: van, kind: van, position_m: [6.0, 3.2], speed_mps: 5.6}]
  - name: turning-left
    frames: 4
    host: {speed_kmh: [12], yaw_rate_degps: [15]}
    street: {lanes_left: 1, lanes_right: 1, curvature_per_m: 0.0785}
    actors: [{name: walker, kind: adult, position_m: [8.5, 1.6], heading_deg: -80, speed_mps: 1.4}]
  - name: turning-right
    frames: 4
    host: {speed_kmh: [10], yaw_rate_degps: [-14]}
    street: {lanes_left: 1, lanes_right: 1, curvature_per_m: -0.088}
    actors: [{name: walker, kind: adult, position_m: [8.8, -1.8], heading_deg: 80, speed_mps: 1.4}]
  - name: turning-left-slowly
    frames: 4
    host: {speed_kmh: [8], yaw_rate_degps: [12]}
    street: {lanes_left: 1, lanes_right: 1, curvature_per_m: 0.0943}
    actors: [{name: walker, kind: short_adult, position_m: [8.0, -1.2], heading_deg: 95, speed_mps: 1.3}]
  - name: turning-right-slowly
    frames: 4
    host: {speed_kmh: [9], yaw_rate_degps: [-16]}
    street: {lanes_left: 1, lanes_right: 1, curvature_per_m: -0.1}
    actors: [{name: cyclist, kind: cyclist, position_m: [9.5, 2.0], heading_deg: -90, speed_mps: 3.5}]
  - name: standing
    frames: 4
    host: {speed_kmh: [0]}
    actors: [{name: walker, kind: adult, position_m: [7.5, -1.0], heading_deg: 90, speed_mps: 1.4}]
  - name: standing-again
    frames: 4
    host: {speed_kmh: [0]}
    actors: [{name: walker, kind: short_adult, position_m: [7.0, 1.2], heading_deg: -90, speed_mps: 1.3}]
"""

CARD = """
name: gated
title: twelve short drives for seeded regressions
adapter: native
root: data/gated
scenario: gated.scenario.yaml
licence: CC0-1.0
splits:
  all: "*"
"""

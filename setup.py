"""Serves both catkin_python_setup and pip: what is ROS-free installs without ROS."""

from setuptools import Extension, find_packages, setup

setup(
    name='obst_avoid',
    version='0.1.0',
    description='Detection and avoidance of duckies and cones for Duckietown robots',
    license='BSD-3-Clause',
    python_requires='>=3.8',
    packages=find_packages('src'),
    package_dir={'': 'src'},
    package_data={'obst_avoid.offline.evaluation': ['*.html'], 'obst_avoid.core.detection.robust': ['*.npz']},
    ext_modules=[
        Extension(  # without a compiler numpy does its work
            'obst_avoid._native',
            ['src/obst_avoid/core/detection/robust/native.c'],
            extra_compile_args=['-O3', '-ffp-contract=off'],
            libraries=['m'],
            optional=True,
        )
    ],
    install_requires=['numpy>=1.17', 'opencv-python-headless>=4.2,<5', 'scikit-image>=0.16', 'PyYAML'],
    extras_require={'sim': ['moderngl', 'shapely', 'scipy']},
)

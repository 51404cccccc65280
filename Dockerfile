# Robot side, for ROS Noetic on arm64 and amd64. Built on the robot or with buildx, as Duckietown's images are:
#   docker build -t obst_avoid .
#   docker build -t obst_avoid --build-arg BASE=duckietown/dt-ros-commons:daffy-arm64v8 .   # with duckietown_msgs
# Not built by our tests, which have no docker.
ARG BASE=ros:noetic-ros-base-focal
FROM ${BASE}
SHELL ["/bin/bash", "-c"]

COPY deps/ubuntu-20.04.txt /tmp/packages.txt
RUN apt-get update \
 && sed '/^# tools/,$d; /^#/d' /tmp/packages.txt | xargs apt-get install -y --no-install-recommends \
 && rm -rf /var/lib/apt/lists/* /tmp/packages.txt

COPY . /code/obst_avoid
RUN source /opt/ros/noetic/setup.bash \
 && if [ -f /code/catkin_ws/devel/setup.bash ]; then source /code/catkin_ws/devel/setup.bash; fi \
 && cmake -S /code/obst_avoid -B /tmp/build -DPYTHON_EXECUTABLE=/usr/bin/python3 -DCATKIN_ENABLE_TESTING=OFF \
      -DCMAKE_INSTALL_PREFIX=/opt/obst_avoid \
 && cmake --build /tmp/build && cmake --install /tmp/build && rm -rf /tmp/build

# For shells, docker exec -it obst_avoid bash, as for what runs.
RUN printf '%s\n' 'source /opt/ros/noetic/setup.bash' \
      'if [ -f /code/catkin_ws/devel/setup.bash ]; then source /code/catkin_ws/devel/setup.bash; fi' \
      'source /opt/obst_avoid/setup.bash --extend' > /opt/obst_avoid/everything.bash \
 && echo 'source /opt/obst_avoid/everything.bash' >> /root/.bashrc

ENV VEHICLE_NAME=duckiebot
# Calibrations and the graph come from the host: docker run --network host -v /data:/data -e VEHICLE_NAME=$(hostname) obst_avoid
# Beside today's stack: -e LAUNCH=daffy.launch
ENV LAUNCH=obst_avoid.launch
# More arguments: -e ARGUMENTS='stage:=stop_only lane_controller:=true'
ENV ARGUMENTS=
CMD source /opt/obst_avoid/everything.bash && exec roslaunch --wait obst_avoid ${LAUNCH} veh:=${VEHICLE_NAME} ${ARGUMENTS}

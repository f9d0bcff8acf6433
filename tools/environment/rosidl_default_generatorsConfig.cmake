# Stands in for ROS's package of this name where ./env builds message packages over the wheels
# (tools/environment/build_interfaces.sh): makes of every message only what rclpy with Fast DDS loads (Fast DDS reads the
# introspection too, to announce a type). The C++ structures and their type supports need most of the build's time, and no wheel
# uses them. A build with colcon takes ROS's own package and makes all of them.
foreach(generator
    rosidl_cmake
    rosidl_generator_type_description
    rosidl_generator_c
    rosidl_typesupport_fastrtps_c
    rosidl_typesupport_introspection_c
    rosidl_typesupport_c
    rosidl_generator_py)
  find_package(${generator} REQUIRED)
endforeach()

# Packages that were found before, such as geometry_msgs, have brought the other generators.
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")

# The generated sources of one library are compiled together: each alone spends its time on the same headers.
# rosidl_generator_c is left out, because its sources define static names more than once.
function(siren_compile_together)
  foreach(library
      rosidl_typesupport_fastrtps_c
      rosidl_typesupport_introspection_c
      rosidl_typesupport_c
      rosidl_generator_py)
    set_target_properties(${PROJECT_NAME}__${library} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
  endforeach()
endfunction()
cmake_language(DEFER CALL siren_compile_together)

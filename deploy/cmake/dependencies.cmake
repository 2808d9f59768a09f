# SPDX-License-Identifier: Apache-2.0
# Third-party libraries as imported targets. All are Debian 12 packages (deploy/install).
find_package(Threads REQUIRED)
find_package(fmt REQUIRED)
find_package(spdlog REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(OpenSSL REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(CycloneDDS REQUIRED)
find_package(CLI11 REQUIRED)
find_package(PkgConfig REQUIRED)

# the heavy ones are looked up by the folders that own them (owners: tests/check_includes)
pkg_check_modules(deflate REQUIRED IMPORTED_TARGET libdeflate)

if(ETUDE_DEV)
  find_package(GTest REQUIRED)
endif()

// Generated from flockstep.proto by server/generate.py.
#include "protocol/messages.hpp"

#include "protocol/read_values.hpp"

namespace flockstep::protocol {

void Array::write(protozero::pbf_writer& writer) const {
  if (!name.empty()) writer.add_string(1, name);
  if (dtype != DType{}) writer.add_enum(2, static_cast<std::int32_t>(dtype));
  writer.add_packed_uint64(3, shape.begin(), shape.end());
}
void Array::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        name = short_text(read_string(reader, "name"), "name");
        break;
      case 2:
        dtype = static_cast<DType>(read_enum(reader, kLastDType, "dtype"));
        break;
      case 3:
        for (const auto value : packed_uint64(reader, "shape")) shape.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void Hello::write(protozero::pbf_writer& writer) const {
  if (protocol != std::uint32_t{}) writer.add_uint32(1, protocol);
  if (!token.empty()) writer.add_string(2, token);
  if (!client.empty()) writer.add_string(3, client);
}
void Hello::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        protocol = read_uint32(reader, "protocol");
        break;
      case 2:
        token = short_text(read_string(reader, "token"), "token");
        break;
      case 3:
        client = short_text(read_string(reader, "client"), "client");
        break;
      default:
        reader.skip();
    }
  }
}

void Ping::write(protozero::pbf_writer&) const {}
void Ping::read(protozero::pbf_reader reader) { skip_all(reader); }

void Claim::write(protozero::pbf_writer& writer) const { writer.add_packed_int64(1, drones.begin(), drones.end()); }
void Claim::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        for (const auto value : packed_int64(reader, "drones")) drones.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void Release::write(protozero::pbf_writer& writer) const { writer.add_packed_int64(1, drones.begin(), drones.end()); }
void Release::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        for (const auto value : packed_int64(reader, "drones")) drones.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void GetDrones::write(protozero::pbf_writer&) const {}
void GetDrones::read(protozero::pbf_reader reader) { skip_all(reader); }

void Vector3::write(protozero::pbf_writer& writer) const {
  if (x != float{}) writer.add_float(1, x);
  if (y != float{}) writer.add_float(2, y);
  if (z != float{}) writer.add_float(3, z);
}
void Vector3::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        x = finite(read_float(reader, "x"), "x");
        break;
      case 2:
        y = finite(read_float(reader, "y"), "y");
        break;
      case 3:
        z = finite(read_float(reader, "z"), "z");
        break;
      default:
        reader.skip();
    }
  }
}

void Quaternion::write(protozero::pbf_writer& writer) const {
  if (w != float{}) writer.add_float(1, w);
  if (x != float{}) writer.add_float(2, x);
  if (y != float{}) writer.add_float(3, y);
  if (z != float{}) writer.add_float(4, z);
}
void Quaternion::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        w = finite(read_float(reader, "w"), "w");
        break;
      case 2:
        x = finite(read_float(reader, "x"), "x");
        break;
      case 3:
        y = finite(read_float(reader, "y"), "y");
        break;
      case 4:
        z = finite(read_float(reader, "z"), "z");
        break;
      default:
        reader.skip();
    }
  }
}

void SpawnDrone::write(protozero::pbf_writer& writer) const {
  if (location) write_message(writer, 1, *location);
  if (rotation) write_message(writer, 2, *rotation);
  if (env) writer.add_int64(3, *env);
  if (claim != bool{}) writer.add_bool(4, claim);
}
void SpawnDrone::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "location");
        location.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      case 3:
        env = read_int64(reader, "env");
        break;
      case 4:
        claim = read_bool(reader, "claim");
        break;
      default:
        reader.skip();
    }
  }
}

void RemoveDrone::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
}
void RemoveDrone::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      default:
        reader.skip();
    }
  }
}

void GetCameraCaptureMode::write(protozero::pbf_writer& writer) const {
  if (!camera.empty()) writer.add_string(1, camera);
}
void GetCameraCaptureMode::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        camera = short_text(read_string(reader, "camera"), "camera");
        break;
      default:
        reader.skip();
    }
  }
}

void SetCameraCaptureMode::write(protozero::pbf_writer& writer) const {
  if (!camera.empty()) writer.add_string(1, camera);
  if (mode != CaptureModeName{}) writer.add_enum(2, static_cast<std::int32_t>(mode));
}
void SetCameraCaptureMode::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        camera = short_text(read_string(reader, "camera"), "camera");
        break;
      case 2:
        mode = static_cast<CaptureModeName>(read_enum(reader, kLastCaptureModeName, "mode"));
        break;
      default:
        reader.skip();
    }
  }
}

void GetFps::write(protozero::pbf_writer&) const {}
void GetFps::read(protozero::pbf_reader reader) { skip_all(reader); }

void GetLocation::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
}
void GetLocation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      default:
        reader.skip();
    }
  }
}

void SetLocation::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (location) write_message(writer, 2, *location);
  if (teleport != bool{}) writer.add_bool(3, teleport);
}
void SetLocation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "location");
        location.emplace().read(reader.get_message());
        break;
      case 3:
        teleport = read_bool(reader, "teleport");
        break;
      default:
        reader.skip();
    }
  }
}

void GetRotation::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
}
void GetRotation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      default:
        reader.skip();
    }
  }
}

void Angles::write(protozero::pbf_writer& writer) const {
  if (roll_deg != float{}) writer.add_float(1, roll_deg);
  if (pitch_deg != float{}) writer.add_float(2, pitch_deg);
  if (yaw_deg != float{}) writer.add_float(3, yaw_deg);
}
void Angles::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        roll_deg = finite(read_float(reader, "roll_deg"), "roll_deg");
        break;
      case 2:
        pitch_deg = finite(read_float(reader, "pitch_deg"), "pitch_deg");
        break;
      case 3:
        yaw_deg = finite(read_float(reader, "yaw_deg"), "yaw_deg");
        break;
      default:
        reader.skip();
    }
  }
}

void SetRotation::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (const auto* const value = std::get_if<Quaternion>(&rotation)) {
    write_message(writer, 2, *value);
  }
  if (const auto* const value = std::get_if<Angles>(&rotation)) {
    write_message(writer, 3, *value);
  }
  if (teleport != bool{}) writer.add_bool(4, teleport);
}
void SetRotation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "quaternion");
        rotation.emplace<Quaternion>().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "angles");
        rotation.emplace<Angles>().read(reader.get_message());
        break;
      case 4:
        teleport = read_bool(reader, "teleport");
        break;
      default:
        reader.skip();
    }
  }
}

void SetLocationAndRotation::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (location) write_message(writer, 2, *location);
  if (const auto* const value = std::get_if<Quaternion>(&rotation)) {
    write_message(writer, 3, *value);
  }
  if (const auto* const value = std::get_if<Angles>(&rotation)) {
    write_message(writer, 4, *value);
  }
  if (teleport != bool{}) writer.add_bool(5, teleport);
}
void SetLocationAndRotation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "location");
        location.emplace().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "quaternion");
        rotation.emplace<Quaternion>().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "angles");
        rotation.emplace<Angles>().read(reader.get_message());
        break;
      case 5:
        teleport = read_bool(reader, "teleport");
        break;
      default:
        reader.skip();
    }
  }
}

void GetCameraData::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!camera.empty()) writer.add_string(2, camera);
  if (format != ImageFormat{}) writer.add_enum(3, static_cast<std::int32_t>(format));
  if (quality != std::uint32_t{}) writer.add_uint32(4, quality);
  if (!output.empty()) writer.add_string(5, output);
}
void GetCameraData::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        camera = short_text(read_string(reader, "camera"), "camera");
        break;
      case 3:
        format = static_cast<ImageFormat>(read_enum(reader, kLastImageFormat, "format"));
        break;
      case 4:
        quality = read_uint32(reader, "quality");
        break;
      case 5:
        output = short_text(read_string(reader, "output"), "output");
        break;
      default:
        reader.skip();
    }
  }
}

void GetLidarData::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!lidar.empty()) writer.add_string(2, lidar);
  if (without_directions != bool{}) writer.add_bool(3, without_directions);
}
void GetLidarData::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        lidar = short_text(read_string(reader, "lidar"), "lidar");
        break;
      case 3:
        without_directions = read_bool(reader, "without_directions");
        break;
      default:
        reader.skip();
    }
  }
}

void GetLidarConfig::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!lidar.empty()) writer.add_string(2, lidar);
}
void GetLidarConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        lidar = short_text(read_string(reader, "lidar"), "lidar");
        break;
      default:
        reader.skip();
    }
  }
}

void LidarConfig::write(protozero::pbf_writer& writer) const {
  if (channels) writer.add_int32(1, *channels);
  if (beams) writer.add_int32(2, *beams);
  if (hfov_deg) writer.add_float(3, *hfov_deg);
  if (vfov_deg) writer.add_float(4, *vfov_deg);
  if (max_range_m) writer.add_float(5, *max_range_m);
  if (offset_m) write_message(writer, 6, *offset_m);
  if (rotation) write_message(writer, 7, *rotation);
}
void LidarConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        channels = read_int32(reader, "channels");
        break;
      case 2:
        beams = read_int32(reader, "beams");
        break;
      case 3:
        hfov_deg = finite(read_float(reader, "hfov_deg"), "hfov_deg");
        break;
      case 4:
        vfov_deg = finite(read_float(reader, "vfov_deg"), "vfov_deg");
        break;
      case 5:
        max_range_m = finite(read_float(reader, "max_range_m"), "max_range_m");
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "offset_m");
        offset_m.emplace().read(reader.get_message());
        break;
      case 7:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void SetLidarConfig::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!lidar.empty()) writer.add_string(2, lidar);
  if (config) write_message(writer, 3, *config);
}
void SetLidarConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        lidar = short_text(read_string(reader, "lidar"), "lidar");
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "config");
        config.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void GetCameraConfig::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!camera.empty()) writer.add_string(2, camera);
}
void GetCameraConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        camera = short_text(read_string(reader, "camera"), "camera");
        break;
      default:
        reader.skip();
    }
  }
}

void CameraConfig::write(protozero::pbf_writer& writer) const {
  if (width_px) writer.add_int32(1, *width_px);
  if (height_px) writer.add_int32(2, *height_px);
  if (hfov_deg) writer.add_float(3, *hfov_deg);
  if (vfov_deg) writer.add_float(4, *vfov_deg);
  if (offset_m) write_message(writer, 5, *offset_m);
  if (rotation) write_message(writer, 6, *rotation);
  if (near_m) writer.add_float(7, *near_m);
  if (far_m) writer.add_float(8, *far_m);
  for (const auto& value : outputs) writer.add_string(9, value);
}
void CameraConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        width_px = read_int32(reader, "width_px");
        break;
      case 2:
        height_px = read_int32(reader, "height_px");
        break;
      case 3:
        hfov_deg = finite(read_float(reader, "hfov_deg"), "hfov_deg");
        break;
      case 4:
        vfov_deg = finite(read_float(reader, "vfov_deg"), "vfov_deg");
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "offset_m");
        offset_m.emplace().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      case 7:
        near_m = finite(read_float(reader, "near_m"), "near_m");
        break;
      case 8:
        far_m = finite(read_float(reader, "far_m"), "far_m");
        break;
      case 9:
        outputs.push_back(short_text(read_string(reader, "outputs"), "outputs"));
        break;
      default:
        reader.skip();
    }
  }
}

void SetCameraConfig::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (!camera.empty()) writer.add_string(2, camera);
  if (config) write_message(writer, 3, *config);
}
void SetCameraConfig::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        camera = short_text(read_string(reader, "camera"), "camera");
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "config");
        config.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void GetMoveLineVisible::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
}
void GetMoveLineVisible::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      default:
        reader.skip();
    }
  }
}

void SetMoveLineVisible::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (visible != bool{}) writer.add_bool(2, visible);
}
void SetMoveLineVisible::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        visible = read_bool(reader, "visible");
        break;
      default:
        reader.skip();
    }
  }
}

void GetArrays::write(protozero::pbf_writer& writer) const {
  for (const auto& value : names) writer.add_string(1, value);
  if (!sensor.empty()) writer.add_string(2, sensor);
}
void GetArrays::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        names.push_back(short_text(read_string(reader, "names"), "names"));
        break;
      case 2:
        sensor = short_text(read_string(reader, "sensor"), "sensor");
        break;
      default:
        reader.skip();
    }
  }
}

void SetPoses::write(protozero::pbf_writer& writer) const {
  if (teleport != bool{}) writer.add_bool(1, teleport);
}
void SetPoses::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        teleport = read_bool(reader, "teleport");
        break;
      default:
        reader.skip();
    }
  }
}

void Fly::write(protozero::pbf_writer& writer) const {
  if (ticks != std::uint32_t{}) writer.add_uint32(1, ticks);
  if (!control.empty()) writer.add_string(2, control);
}
void Fly::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        ticks = read_uint32(reader, "ticks");
        break;
      case 2:
        control = short_text(read_string(reader, "control"), "control");
        break;
      default:
        reader.skip();
    }
  }
}

void SetCommand::write(protozero::pbf_writer& writer) const {
  if (drone) writer.add_int64(1, *drone);
  if (!control.empty()) writer.add_string(2, control);
}
void SetCommand::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        control = short_text(read_string(reader, "control"), "control");
        break;
      default:
        reader.skip();
    }
  }
}

void Step::write(protozero::pbf_writer&) const {}
void Step::read(protozero::pbf_reader reader) { skip_all(reader); }

void SetClock::write(protozero::pbf_writer& writer) const {
  if (rate_hz != double{}) writer.add_double(1, rate_hz);
}
void SetClock::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        rate_hz = finite(read_double(reader, "rate_hz"), "rate_hz");
        break;
      default:
        reader.skip();
    }
  }
}

void JoinLockstep::write(protozero::pbf_writer&) const {}
void JoinLockstep::read(protozero::pbf_reader reader) { skip_all(reader); }

void LeaveLockstep::write(protozero::pbf_writer&) const {}
void LeaveLockstep::read(protozero::pbf_reader reader) { skip_all(reader); }

void Sense::write(protozero::pbf_writer&) const {}
void Sense::read(protozero::pbf_reader reader) { skip_all(reader); }

void Snapshot::write(protozero::pbf_writer&) const {}
void Snapshot::read(protozero::pbf_reader reader) { skip_all(reader); }

void Restore::write(protozero::pbf_writer&) const {}
void Restore::read(protozero::pbf_reader reader) { skip_all(reader); }

void GetWorlds::write(protozero::pbf_writer&) const {}
void GetWorlds::read(protozero::pbf_reader reader) { skip_all(reader); }

void SetWorld::write(protozero::pbf_writer& writer) const {
  if (env != std::int64_t{}) writer.add_int64(1, env);
  if (world != std::uint32_t{}) writer.add_uint32(2, world);
}
void SetWorld::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        env = read_int64(reader, "env");
        break;
      case 2:
        world = read_uint32(reader, "world");
        break;
      default:
        reader.skip();
    }
  }
}

void GetLight::write(protozero::pbf_writer& writer) const {
  if (world != std::uint32_t{}) writer.add_uint32(1, world);
  if (env) writer.add_int64(2, *env);
}
void GetLight::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        world = read_uint32(reader, "world");
        break;
      case 2:
        env = read_int64(reader, "env");
        break;
      default:
        reader.skip();
    }
  }
}

void Light::write(protozero::pbf_writer& writer) const {
  if (sun_direction) write_message(writer, 1, *sun_direction);
  if (sun_color) write_message(writer, 2, *sun_color);
  if (sky_ambient) write_message(writer, 3, *sky_ambient);
  if (ground_ambient) write_message(writer, 4, *ground_ambient);
  if (zenith_color) write_message(writer, 5, *zenith_color);
  if (horizon_color) write_message(writer, 6, *horizon_color);
  if (gamma) writer.add_float(7, *gamma);
  if (sun_radius_deg) writer.add_float(8, *sun_radius_deg);
  if (sun_glow) writer.add_float(9, *sun_glow);
  if (fog_visibility_m) writer.add_float(10, *fog_visibility_m);
}
void Light::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "sun_direction");
        sun_direction.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "sun_color");
        sun_color.emplace().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "sky_ambient");
        sky_ambient.emplace().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "ground_ambient");
        ground_ambient.emplace().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "zenith_color");
        zenith_color.emplace().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "horizon_color");
        horizon_color.emplace().read(reader.get_message());
        break;
      case 7:
        gamma = finite(read_float(reader, "gamma"), "gamma");
        break;
      case 8:
        sun_radius_deg = finite(read_float(reader, "sun_radius_deg"), "sun_radius_deg");
        break;
      case 9:
        sun_glow = finite(read_float(reader, "sun_glow"), "sun_glow");
        break;
      case 10:
        fog_visibility_m = finite(read_float(reader, "fog_visibility_m"), "fog_visibility_m");
        break;
      default:
        reader.skip();
    }
  }
}

void SetLight::write(protozero::pbf_writer& writer) const {
  if (world != std::uint32_t{}) writer.add_uint32(1, world);
  if (light) write_message(writer, 2, *light);
  writer.add_packed_int64(3, envs.begin(), envs.end());
}
void SetLight::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        world = read_uint32(reader, "world");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "light");
        light.emplace().read(reader.get_message());
        break;
      case 3:
        for (const auto value : packed_int64(reader, "envs")) envs.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void GetMesh::write(protozero::pbf_writer& writer) const {
  if (world != std::uint32_t{}) writer.add_uint32(1, world);
}
void GetMesh::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        world = read_uint32(reader, "world");
        break;
      default:
        reader.skip();
    }
  }
}

void GetPointCloud::write(protozero::pbf_writer& writer) const {
  if (world != std::uint32_t{}) writer.add_uint32(1, world);
  if (spacing_m != float{}) writer.add_float(2, spacing_m);
}
void GetPointCloud::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        world = read_uint32(reader, "world");
        break;
      case 2:
        spacing_m = finite(read_float(reader, "spacing_m"), "spacing_m");
        break;
      default:
        reader.skip();
    }
  }
}

void GetBoxes::write(protozero::pbf_writer& writer) const {
  if (world != std::uint32_t{}) writer.add_uint32(1, world);
}
void GetBoxes::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        world = read_uint32(reader, "world");
        break;
      default:
        reader.skip();
    }
  }
}

void Subscribe::write(protozero::pbf_writer& writer) const {
  if (rate_hz != double{}) writer.add_double(1, rate_hz);
  if (const auto* const value = std::get_if<GetArrays>(&what)) {
    write_message(writer, 2, *value);
  }
  if (const auto* const value = std::get_if<GetLidarData>(&what)) {
    write_message(writer, 3, *value);
  }
  if (const auto* const value = std::get_if<GetCameraData>(&what)) {
    write_message(writer, 4, *value);
  }
  if (const auto* const value = std::get_if<GetFps>(&what)) {
    write_message(writer, 5, *value);
  }
  if (only_new != bool{}) writer.add_bool(6, only_new);
}
void Subscribe::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        rate_hz = finite(read_double(reader, "rate_hz"), "rate_hz");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "arrays");
        what.emplace<GetArrays>().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "lidar");
        what.emplace<GetLidarData>().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "camera");
        what.emplace<GetCameraData>().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "fps");
        what.emplace<GetFps>().read(reader.get_message());
        break;
      case 6:
        only_new = read_bool(reader, "only_new");
        break;
      default:
        reader.skip();
    }
  }
}

void Unsubscribe::write(protozero::pbf_writer& writer) const {
  if (stream != std::uint64_t{}) writer.add_uint64(1, stream);
}
void Unsubscribe::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        stream = read_uint64(reader, "stream");
        break;
      default:
        reader.skip();
    }
  }
}

void GetTask::write(protozero::pbf_writer&) const {}
void GetTask::read(protozero::pbf_reader reader) { skip_all(reader); }

void ResetEnvs::write(protozero::pbf_writer&) const {}
void ResetEnvs::read(protozero::pbf_reader reader) { skip_all(reader); }

void StepEnvs::write(protozero::pbf_writer&) const {}
void StepEnvs::read(protozero::pbf_reader reader) { skip_all(reader); }

void SpawnBodies::write(protozero::pbf_writer& writer) const {
  if (!config_json.empty()) writer.add_string(1, config_json);
}
void SpawnBodies::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        config_json = long_text(read_string(reader, "config_json"), "config_json");
        break;
      default:
        reader.skip();
    }
  }
}

void RemoveBodies::write(protozero::pbf_writer&) const {}
void RemoveBodies::read(protozero::pbf_reader reader) { skip_all(reader); }

void SetBodyPoses::write(protozero::pbf_writer&) const {}
void SetBodyPoses::read(protozero::pbf_reader reader) { skip_all(reader); }

void SetBodyVelocities::write(protozero::pbf_writer&) const {}
void SetBodyVelocities::read(protozero::pbf_reader reader) { skip_all(reader); }

void GetBodyConfigs::write(protozero::pbf_writer& writer) const { writer.add_packed_int64(1, envs.begin(), envs.end()); }
void GetBodyConfigs::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        for (const auto value : packed_int64(reader, "envs")) envs.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void Request::write(protozero::pbf_writer& writer) const {
  if (id != std::uint64_t{}) writer.add_uint64(1, id);
  for (const auto& value : arrays) write_message(writer, 2, value);
  if (const auto* const value = std::get_if<Hello>(&operation)) {
    write_message(writer, 3, *value);
  }
  if (const auto* const value = std::get_if<Ping>(&operation)) {
    write_message(writer, 4, *value);
  }
  if (const auto* const value = std::get_if<Claim>(&operation)) {
    write_message(writer, 5, *value);
  }
  if (const auto* const value = std::get_if<Release>(&operation)) {
    write_message(writer, 6, *value);
  }
  if (const auto* const value = std::get_if<GetDrones>(&operation)) {
    write_message(writer, 10, *value);
  }
  if (const auto* const value = std::get_if<SpawnDrone>(&operation)) {
    write_message(writer, 11, *value);
  }
  if (const auto* const value = std::get_if<RemoveDrone>(&operation)) {
    write_message(writer, 12, *value);
  }
  if (const auto* const value = std::get_if<GetCameraCaptureMode>(&operation)) {
    write_message(writer, 13, *value);
  }
  if (const auto* const value = std::get_if<SetCameraCaptureMode>(&operation)) {
    write_message(writer, 14, *value);
  }
  if (const auto* const value = std::get_if<GetFps>(&operation)) {
    write_message(writer, 15, *value);
  }
  if (const auto* const value = std::get_if<GetLocation>(&operation)) {
    write_message(writer, 20, *value);
  }
  if (const auto* const value = std::get_if<SetLocation>(&operation)) {
    write_message(writer, 21, *value);
  }
  if (const auto* const value = std::get_if<GetRotation>(&operation)) {
    write_message(writer, 22, *value);
  }
  if (const auto* const value = std::get_if<SetRotation>(&operation)) {
    write_message(writer, 23, *value);
  }
  if (const auto* const value = std::get_if<SetLocationAndRotation>(&operation)) {
    write_message(writer, 24, *value);
  }
  if (const auto* const value = std::get_if<GetCameraData>(&operation)) {
    write_message(writer, 25, *value);
  }
  if (const auto* const value = std::get_if<GetLidarData>(&operation)) {
    write_message(writer, 26, *value);
  }
  if (const auto* const value = std::get_if<GetLidarConfig>(&operation)) {
    write_message(writer, 27, *value);
  }
  if (const auto* const value = std::get_if<SetLidarConfig>(&operation)) {
    write_message(writer, 28, *value);
  }
  if (const auto* const value = std::get_if<GetCameraConfig>(&operation)) {
    write_message(writer, 29, *value);
  }
  if (const auto* const value = std::get_if<SetCameraConfig>(&operation)) {
    write_message(writer, 30, *value);
  }
  if (const auto* const value = std::get_if<GetMoveLineVisible>(&operation)) {
    write_message(writer, 31, *value);
  }
  if (const auto* const value = std::get_if<SetMoveLineVisible>(&operation)) {
    write_message(writer, 32, *value);
  }
  if (const auto* const value = std::get_if<GetArrays>(&operation)) {
    write_message(writer, 40, *value);
  }
  if (const auto* const value = std::get_if<SetPoses>(&operation)) {
    write_message(writer, 41, *value);
  }
  if (const auto* const value = std::get_if<Fly>(&operation)) {
    write_message(writer, 42, *value);
  }
  if (const auto* const value = std::get_if<SetCommand>(&operation)) {
    write_message(writer, 43, *value);
  }
  if (const auto* const value = std::get_if<Step>(&operation)) {
    write_message(writer, 50, *value);
  }
  if (const auto* const value = std::get_if<SetClock>(&operation)) {
    write_message(writer, 51, *value);
  }
  if (const auto* const value = std::get_if<JoinLockstep>(&operation)) {
    write_message(writer, 52, *value);
  }
  if (const auto* const value = std::get_if<LeaveLockstep>(&operation)) {
    write_message(writer, 53, *value);
  }
  if (const auto* const value = std::get_if<Sense>(&operation)) {
    write_message(writer, 54, *value);
  }
  if (const auto* const value = std::get_if<Snapshot>(&operation)) {
    write_message(writer, 55, *value);
  }
  if (const auto* const value = std::get_if<Restore>(&operation)) {
    write_message(writer, 56, *value);
  }
  if (const auto* const value = std::get_if<GetWorlds>(&operation)) {
    write_message(writer, 60, *value);
  }
  if (const auto* const value = std::get_if<SetWorld>(&operation)) {
    write_message(writer, 61, *value);
  }
  if (const auto* const value = std::get_if<GetLight>(&operation)) {
    write_message(writer, 62, *value);
  }
  if (const auto* const value = std::get_if<SetLight>(&operation)) {
    write_message(writer, 63, *value);
  }
  if (const auto* const value = std::get_if<GetMesh>(&operation)) {
    write_message(writer, 64, *value);
  }
  if (const auto* const value = std::get_if<GetPointCloud>(&operation)) {
    write_message(writer, 65, *value);
  }
  if (const auto* const value = std::get_if<GetBoxes>(&operation)) {
    write_message(writer, 66, *value);
  }
  if (const auto* const value = std::get_if<Subscribe>(&operation)) {
    write_message(writer, 70, *value);
  }
  if (const auto* const value = std::get_if<Unsubscribe>(&operation)) {
    write_message(writer, 71, *value);
  }
  if (const auto* const value = std::get_if<GetTask>(&operation)) {
    write_message(writer, 80, *value);
  }
  if (const auto* const value = std::get_if<ResetEnvs>(&operation)) {
    write_message(writer, 81, *value);
  }
  if (const auto* const value = std::get_if<StepEnvs>(&operation)) {
    write_message(writer, 82, *value);
  }
  if (const auto* const value = std::get_if<SpawnBodies>(&operation)) {
    write_message(writer, 90, *value);
  }
  if (const auto* const value = std::get_if<RemoveBodies>(&operation)) {
    write_message(writer, 91, *value);
  }
  if (const auto* const value = std::get_if<SetBodyPoses>(&operation)) {
    write_message(writer, 92, *value);
  }
  if (const auto* const value = std::get_if<SetBodyVelocities>(&operation)) {
    write_message(writer, 93, *value);
  }
  if (const auto* const value = std::get_if<GetBodyConfigs>(&operation)) {
    write_message(writer, 94, *value);
  }
}
void Request::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        id = read_uint64(reader, "id");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "arrays");
        arrays.emplace_back().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "hello");
        operation.emplace<Hello>().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "ping");
        operation.emplace<Ping>().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "claim");
        operation.emplace<Claim>().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "release");
        operation.emplace<Release>().read(reader.get_message());
        break;
      case 10:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_drones");
        operation.emplace<GetDrones>().read(reader.get_message());
        break;
      case 11:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "spawn_drone");
        operation.emplace<SpawnDrone>().read(reader.get_message());
        break;
      case 12:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "remove_drone");
        operation.emplace<RemoveDrone>().read(reader.get_message());
        break;
      case 13:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_camera_capture_mode");
        operation.emplace<GetCameraCaptureMode>().read(reader.get_message());
        break;
      case 14:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_camera_capture_mode");
        operation.emplace<SetCameraCaptureMode>().read(reader.get_message());
        break;
      case 15:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_fps");
        operation.emplace<GetFps>().read(reader.get_message());
        break;
      case 20:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_location");
        operation.emplace<GetLocation>().read(reader.get_message());
        break;
      case 21:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_location");
        operation.emplace<SetLocation>().read(reader.get_message());
        break;
      case 22:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_rotation");
        operation.emplace<GetRotation>().read(reader.get_message());
        break;
      case 23:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_rotation");
        operation.emplace<SetRotation>().read(reader.get_message());
        break;
      case 24:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_location_and_rotation");
        operation.emplace<SetLocationAndRotation>().read(reader.get_message());
        break;
      case 25:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_camera_data");
        operation.emplace<GetCameraData>().read(reader.get_message());
        break;
      case 26:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_lidar_data");
        operation.emplace<GetLidarData>().read(reader.get_message());
        break;
      case 27:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_lidar_config");
        operation.emplace<GetLidarConfig>().read(reader.get_message());
        break;
      case 28:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_lidar_config");
        operation.emplace<SetLidarConfig>().read(reader.get_message());
        break;
      case 29:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_camera_config");
        operation.emplace<GetCameraConfig>().read(reader.get_message());
        break;
      case 30:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_camera_config");
        operation.emplace<SetCameraConfig>().read(reader.get_message());
        break;
      case 31:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_move_line_visible");
        operation.emplace<GetMoveLineVisible>().read(reader.get_message());
        break;
      case 32:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_move_line_visible");
        operation.emplace<SetMoveLineVisible>().read(reader.get_message());
        break;
      case 40:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_arrays");
        operation.emplace<GetArrays>().read(reader.get_message());
        break;
      case 41:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_poses");
        operation.emplace<SetPoses>().read(reader.get_message());
        break;
      case 42:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "fly");
        operation.emplace<Fly>().read(reader.get_message());
        break;
      case 43:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_command");
        operation.emplace<SetCommand>().read(reader.get_message());
        break;
      case 50:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "step");
        operation.emplace<Step>().read(reader.get_message());
        break;
      case 51:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_clock");
        operation.emplace<SetClock>().read(reader.get_message());
        break;
      case 52:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "join_lockstep");
        operation.emplace<JoinLockstep>().read(reader.get_message());
        break;
      case 53:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "leave_lockstep");
        operation.emplace<LeaveLockstep>().read(reader.get_message());
        break;
      case 54:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "sense");
        operation.emplace<Sense>().read(reader.get_message());
        break;
      case 55:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "snapshot");
        operation.emplace<Snapshot>().read(reader.get_message());
        break;
      case 56:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "restore");
        operation.emplace<Restore>().read(reader.get_message());
        break;
      case 60:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_worlds");
        operation.emplace<GetWorlds>().read(reader.get_message());
        break;
      case 61:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_world");
        operation.emplace<SetWorld>().read(reader.get_message());
        break;
      case 62:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_light");
        operation.emplace<GetLight>().read(reader.get_message());
        break;
      case 63:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_light");
        operation.emplace<SetLight>().read(reader.get_message());
        break;
      case 64:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_mesh");
        operation.emplace<GetMesh>().read(reader.get_message());
        break;
      case 65:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_point_cloud");
        operation.emplace<GetPointCloud>().read(reader.get_message());
        break;
      case 66:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_boxes");
        operation.emplace<GetBoxes>().read(reader.get_message());
        break;
      case 70:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "subscribe");
        operation.emplace<Subscribe>().read(reader.get_message());
        break;
      case 71:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "unsubscribe");
        operation.emplace<Unsubscribe>().read(reader.get_message());
        break;
      case 80:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_task");
        operation.emplace<GetTask>().read(reader.get_message());
        break;
      case 81:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "reset_envs");
        operation.emplace<ResetEnvs>().read(reader.get_message());
        break;
      case 82:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "step_envs");
        operation.emplace<StepEnvs>().read(reader.get_message());
        break;
      case 90:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "spawn_bodies");
        operation.emplace<SpawnBodies>().read(reader.get_message());
        break;
      case 91:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "remove_bodies");
        operation.emplace<RemoveBodies>().read(reader.get_message());
        break;
      case 92:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_body_poses");
        operation.emplace<SetBodyPoses>().read(reader.get_message());
        break;
      case 93:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "set_body_velocities");
        operation.emplace<SetBodyVelocities>().read(reader.get_message());
        break;
      case 94:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "get_body_configs");
        operation.emplace<GetBodyConfigs>().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void Done::write(protozero::pbf_writer&) const {}
void Done::read(protozero::pbf_reader reader) { skip_all(reader); }

void Error::write(protozero::pbf_writer& writer) const {
  if (code != Code{}) writer.add_enum(1, static_cast<std::int32_t>(code));
  if (!text.empty()) writer.add_string(2, text);
}
void Error::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        code = static_cast<Code>(read_enum(reader, kLastCode, "code"));
        break;
      case 2:
        text = read_string(reader, "text");
        break;
      default:
        reader.skip();
    }
  }
}

void Mounting::write(protozero::pbf_writer& writer) const {
  if (offset_m) write_message(writer, 1, *offset_m);
  if (rotation) write_message(writer, 2, *rotation);
}
void Mounting::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "offset_m");
        offset_m.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void Welcome::write(protozero::pbf_writer& writer) const {
  if (protocol != std::uint32_t{}) writer.add_uint32(1, protocol);
  if (!version.empty()) writer.add_string(2, version);
  if (client != std::uint32_t{}) writer.add_uint32(3, client);
  if (num_envs != std::int64_t{}) writer.add_int64(4, num_envs);
  if (drones_per_env != std::int64_t{}) writer.add_int64(5, drones_per_env);
  if (generation != std::int64_t{}) writer.add_int64(6, generation);
  for (const auto& value : lidars) writer.add_string(7, value);
  for (const auto& value : cameras) writer.add_string(8, value);
  for (const auto& value : imus) writer.add_string(9, value);
  if (flies_by_rotors != bool{}) writer.add_bool(10, flies_by_rotors);
  if (has_task != bool{}) writer.add_bool(11, has_task);
  if (step_s != double{}) writer.add_double(12, step_s);
  for (const auto& value : array_names) writer.add_string(13, value);
  for (const auto& value : imu_mountings) write_message(writer, 14, value);
  for (const auto& value : array_rows) writer.add_string(15, value);
  if (bodies_per_env != std::int64_t{}) writer.add_int64(16, bodies_per_env);
}
void Welcome::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        protocol = read_uint32(reader, "protocol");
        break;
      case 2:
        version = read_string(reader, "version");
        break;
      case 3:
        client = read_uint32(reader, "client");
        break;
      case 4:
        num_envs = read_int64(reader, "num_envs");
        break;
      case 5:
        drones_per_env = read_int64(reader, "drones_per_env");
        break;
      case 6:
        generation = read_int64(reader, "generation");
        break;
      case 7:
        lidars.push_back(read_string(reader, "lidars"));
        break;
      case 8:
        cameras.push_back(read_string(reader, "cameras"));
        break;
      case 9:
        imus.push_back(read_string(reader, "imus"));
        break;
      case 10:
        flies_by_rotors = read_bool(reader, "flies_by_rotors");
        break;
      case 11:
        has_task = read_bool(reader, "has_task");
        break;
      case 12:
        step_s = read_double(reader, "step_s");
        break;
      case 13:
        array_names.push_back(read_string(reader, "array_names"));
        break;
      case 14:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "imu_mountings");
        imu_mountings.emplace_back().read(reader.get_message());
        break;
      case 15:
        array_rows.push_back(read_string(reader, "array_rows"));
        break;
      case 16:
        bodies_per_env = read_int64(reader, "bodies_per_env");
        break;
      default:
        reader.skip();
    }
  }
}

void Drone::write(protozero::pbf_writer& writer) const {
  if (drone != std::int64_t{}) writer.add_int64(1, drone);
  if (env != std::int64_t{}) writer.add_int64(2, env);
  if (owner != std::uint32_t{}) writer.add_uint32(3, owner);
}
void Drone::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        drone = read_int64(reader, "drone");
        break;
      case 2:
        env = read_int64(reader, "env");
        break;
      case 3:
        owner = read_uint32(reader, "owner");
        break;
      default:
        reader.skip();
    }
  }
}

void Drones::write(protozero::pbf_writer& writer) const {
  for (const auto& value : drones) write_message(writer, 1, value);
}
void Drones::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "drones");
        drones.emplace_back().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void CaptureMode::write(protozero::pbf_writer& writer) const {
  if (mode != CaptureModeName{}) writer.add_enum(1, static_cast<std::int32_t>(mode));
}
void CaptureMode::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        mode = static_cast<CaptureModeName>(read_enum(reader, kLastCaptureModeName, "mode"));
        break;
      default:
        reader.skip();
    }
  }
}

void Fps::write(protozero::pbf_writer& writer) const {
  if (fps != double{}) writer.add_double(1, fps);
  if (real_time_factor != double{}) writer.add_double(2, real_time_factor);
}
void Fps::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        fps = read_double(reader, "fps");
        break;
      case 2:
        real_time_factor = read_double(reader, "real_time_factor");
        break;
      default:
        reader.skip();
    }
  }
}

void Rotation::write(protozero::pbf_writer& writer) const {
  if (quaternion) write_message(writer, 1, *quaternion);
  if (angles) write_message(writer, 2, *angles);
}
void Rotation::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "quaternion");
        quaternion.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "angles");
        angles.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void Impact::write(protozero::pbf_writer& writer) const {
  if (hit != bool{}) writer.add_bool(1, hit);
  if (fraction != float{}) writer.add_float(2, fraction);
  if (location) write_message(writer, 3, *location);
  if (rotation) write_message(writer, 4, *rotation);
  if (point) write_message(writer, 5, *point);
  if (normal) write_message(writer, 6, *normal);
}
void Impact::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        hit = read_bool(reader, "hit");
        break;
      case 2:
        fraction = read_float(reader, "fraction");
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "location");
        location.emplace().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "point");
        point.emplace().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "normal");
        normal.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void CameraData::write(protozero::pbf_writer& writer) const {
  if (step != std::int64_t{}) writer.add_int64(1, step);
  if (width_px != std::uint32_t{}) writer.add_uint32(2, width_px);
  if (height_px != std::uint32_t{}) writer.add_uint32(3, height_px);
}
void CameraData::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        step = read_int64(reader, "step");
        break;
      case 2:
        width_px = read_uint32(reader, "width_px");
        break;
      case 3:
        height_px = read_uint32(reader, "height_px");
        break;
      default:
        reader.skip();
    }
  }
}

void LidarData::write(protozero::pbf_writer& writer) const {
  if (origin) write_message(writer, 1, *origin);
  if (rotation) write_message(writer, 2, *rotation);
}
void LidarData::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "origin");
        origin.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        rotation.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void MoveLineVisible::write(protozero::pbf_writer& writer) const {
  if (visible != bool{}) writer.add_bool(1, visible);
}
void MoveLineVisible::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        visible = read_bool(reader, "visible");
        break;
      default:
        reader.skip();
    }
  }
}

void Time::write(protozero::pbf_writer& writer) const {
  if (step != std::int64_t{}) writer.add_int64(1, step);
  if (time_s != double{}) writer.add_double(2, time_s);
  if (num_envs != std::int64_t{}) writer.add_int64(3, num_envs);
  if (generation != std::int64_t{}) writer.add_int64(4, generation);
}
void Time::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        step = read_int64(reader, "step");
        break;
      case 2:
        time_s = read_double(reader, "time_s");
        break;
      case 3:
        num_envs = read_int64(reader, "num_envs");
        break;
      case 4:
        generation = read_int64(reader, "generation");
        break;
      default:
        reader.skip();
    }
  }
}

void World::write(protozero::pbf_writer& writer) const {
  if (!name.empty()) writer.add_string(1, name);
  if (content_hash != std::uint64_t{}) writer.add_uint64(2, content_hash);
  if (min) write_message(writer, 3, *min);
  if (max) write_message(writer, 4, *max);
  if (start) write_message(writer, 5, *start);
  if (goal) write_message(writer, 6, *goal);
}
void World::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        name = read_string(reader, "name");
        break;
      case 2:
        content_hash = read_uint64(reader, "content_hash");
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "min");
        min.emplace().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "max");
        max.emplace().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "start");
        start.emplace().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "goal");
        goal.emplace().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void Worlds::write(protozero::pbf_writer& writer) const {
  for (const auto& value : worlds) write_message(writer, 1, value);
}
void Worlds::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "worlds");
        worlds.emplace_back().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

void Field::write(protozero::pbf_writer& writer) const {
  if (!name.empty()) writer.add_string(1, name);
  if (dtype != DType{}) writer.add_enum(2, static_cast<std::int32_t>(dtype));
  writer.add_packed_uint64(3, shape.begin(), shape.end());
  writer.add_packed_double(4, low.begin(), low.end());
  writer.add_packed_double(5, high.begin(), high.end());
}
void Field::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        name = read_string(reader, "name");
        break;
      case 2:
        dtype = static_cast<DType>(read_enum(reader, kLastDType, "dtype"));
        break;
      case 3:
        for (const auto value : packed_uint64(reader, "shape")) shape.push_back(value);
        break;
      case 4:
        for (const auto value : packed_double(reader, "low")) low.push_back(value);
        break;
      case 5:
        for (const auto value : packed_double(reader, "high")) high.push_back(value);
        break;
      default:
        reader.skip();
    }
  }
}

void Task::write(protozero::pbf_writer& writer) const {
  if (action) write_message(writer, 1, *action);
  for (const auto& value : observation) write_message(writer, 2, value);
  for (const auto& value : reward_terms) writer.add_string(3, value);
  if (num_rows != std::int64_t{}) writer.add_int64(4, num_rows);
  if (row_is_env != bool{}) writer.add_bool(5, row_is_env);
  if (!autoreset_mode.empty()) writer.add_string(6, autoreset_mode);
  if (policy_hz != double{}) writer.add_double(7, policy_hz);
  if (frame_skip != std::int32_t{}) writer.add_int32(8, frame_skip);
  if (!episodes.empty()) writer.add_string(9, episodes);
}
void Task::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "action");
        action.emplace().read(reader.get_message());
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "observation");
        observation.emplace_back().read(reader.get_message());
        break;
      case 3:
        reward_terms.push_back(read_string(reader, "reward_terms"));
        break;
      case 4:
        num_rows = read_int64(reader, "num_rows");
        break;
      case 5:
        row_is_env = read_bool(reader, "row_is_env");
        break;
      case 6:
        autoreset_mode = read_string(reader, "autoreset_mode");
        break;
      case 7:
        policy_hz = read_double(reader, "policy_hz");
        break;
      case 8:
        frame_skip = read_int32(reader, "frame_skip");
        break;
      case 9:
        episodes = read_string(reader, "episodes");
        break;
      default:
        reader.skip();
    }
  }
}

void BodyConfigs::write(protozero::pbf_writer& writer) const {
  for (const auto& value : config_json) writer.add_string(1, value);
}
void BodyConfigs::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        config_json.push_back(read_string(reader, "config_json"));
        break;
      default:
        reader.skip();
    }
  }
}

void Reply::write(protozero::pbf_writer& writer) const {
  if (id != std::uint64_t{}) writer.add_uint64(1, id);
  for (const auto& value : arrays) write_message(writer, 2, value);
  if (const auto* const value = std::get_if<Done>(&result)) {
    write_message(writer, 3, *value);
  }
  if (const auto* const value = std::get_if<Error>(&result)) {
    write_message(writer, 4, *value);
  }
  if (const auto* const value = std::get_if<Welcome>(&result)) {
    write_message(writer, 5, *value);
  }
  if (const auto* const value = std::get_if<Drones>(&result)) {
    write_message(writer, 6, *value);
  }
  if (const auto* const value = std::get_if<Drone>(&result)) {
    write_message(writer, 7, *value);
  }
  if (const auto* const value = std::get_if<CaptureMode>(&result)) {
    write_message(writer, 8, *value);
  }
  if (const auto* const value = std::get_if<Fps>(&result)) {
    write_message(writer, 9, *value);
  }
  if (const auto* const value = std::get_if<Vector3>(&result)) {
    write_message(writer, 10, *value);
  }
  if (const auto* const value = std::get_if<Rotation>(&result)) {
    write_message(writer, 11, *value);
  }
  if (const auto* const value = std::get_if<Impact>(&result)) {
    write_message(writer, 12, *value);
  }
  if (const auto* const value = std::get_if<CameraData>(&result)) {
    write_message(writer, 13, *value);
  }
  if (const auto* const value = std::get_if<LidarData>(&result)) {
    write_message(writer, 14, *value);
  }
  if (const auto* const value = std::get_if<LidarConfig>(&result)) {
    write_message(writer, 15, *value);
  }
  if (const auto* const value = std::get_if<CameraConfig>(&result)) {
    write_message(writer, 16, *value);
  }
  if (const auto* const value = std::get_if<MoveLineVisible>(&result)) {
    write_message(writer, 17, *value);
  }
  if (const auto* const value = std::get_if<Time>(&result)) {
    write_message(writer, 18, *value);
  }
  if (const auto* const value = std::get_if<Worlds>(&result)) {
    write_message(writer, 19, *value);
  }
  if (const auto* const value = std::get_if<Light>(&result)) {
    write_message(writer, 20, *value);
  }
  if (const auto* const value = std::get_if<Task>(&result)) {
    write_message(writer, 21, *value);
  }
  if (const auto* const value = std::get_if<BodyConfigs>(&result)) {
    write_message(writer, 22, *value);
  }
}
void Reply::read(protozero::pbf_reader reader) {
  while (reader.next()) {
    switch (reader.tag()) {
      case 1:
        id = read_uint64(reader, "id");
        break;
      case 2:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "arrays");
        arrays.emplace_back().read(reader.get_message());
        break;
      case 3:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "done");
        result.emplace<Done>().read(reader.get_message());
        break;
      case 4:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "error");
        result.emplace<Error>().read(reader.get_message());
        break;
      case 5:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "welcome");
        result.emplace<Welcome>().read(reader.get_message());
        break;
      case 6:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "drones");
        result.emplace<Drones>().read(reader.get_message());
        break;
      case 7:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "drone");
        result.emplace<Drone>().read(reader.get_message());
        break;
      case 8:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "capture_mode");
        result.emplace<CaptureMode>().read(reader.get_message());
        break;
      case 9:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "fps");
        result.emplace<Fps>().read(reader.get_message());
        break;
      case 10:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "location");
        result.emplace<Vector3>().read(reader.get_message());
        break;
      case 11:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "rotation");
        result.emplace<Rotation>().read(reader.get_message());
        break;
      case 12:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "impact");
        result.emplace<Impact>().read(reader.get_message());
        break;
      case 13:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "camera_data");
        result.emplace<CameraData>().read(reader.get_message());
        break;
      case 14:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "lidar_data");
        result.emplace<LidarData>().read(reader.get_message());
        break;
      case 15:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "lidar_config");
        result.emplace<LidarConfig>().read(reader.get_message());
        break;
      case 16:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "camera_config");
        result.emplace<CameraConfig>().read(reader.get_message());
        break;
      case 17:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "move_line_visible");
        result.emplace<MoveLineVisible>().read(reader.get_message());
        break;
      case 18:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "time");
        result.emplace<Time>().read(reader.get_message());
        break;
      case 19:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "worlds");
        result.emplace<Worlds>().read(reader.get_message());
        break;
      case 20:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "light");
        result.emplace<Light>().read(reader.get_message());
        break;
      case 21:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "task");
        result.emplace<Task>().read(reader.get_message());
        break;
      case 22:
        require_type(reader, protozero::pbf_wire_type::length_delimited, "body_configs");
        result.emplace<BodyConfigs>().read(reader.get_message());
        break;
      default:
        reader.skip();
    }
  }
}

}  // namespace flockstep::protocol

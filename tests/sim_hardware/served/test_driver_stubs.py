"""The server side of the driver's protocol is no public interface: tell when a new nidaqmx changes it."""

import ast
import inspect

import nidaqmx._grpc_interpreter
import session_pb2
from nidaqmx._stubs import nidaqmx_pb2, nidaqmx_pb2_grpc

from sim_hardware.card.attributes import CHANNEL_GETTERS, DEVICE_PROPERTIES, GETTERS, SETTERS, SYSTEM
from sim_hardware.server.daq_server import DaqServicer

CHANNEL = {"task", "physical_channel", "name_to_assign_to_channel", "min_val", "max_val"}
FIELDS = {
    "CreateTaskRequest": {"session_name", "initialization_behavior"},
    "CreateTaskResponse": {"status", "task", "new_session_initialized"},
    "CreateAIVoltageChanRequest": CHANNEL,
    "CreateAOVoltageChanRequest": CHANNEL,
    "CfgSampClkTimingRequest": {"task", "source", "rate", "sample_mode", "sample_mode_raw", "samps_per_chan"},
    "CfgDigEdgeStartTrigRequest": {"task", "trigger_source"},
    "ReadAnalogF64Request": {"task", "num_samps_per_chan", "timeout", "fill_mode_raw", "array_size_in_samps"},
    "ReadAnalogF64Response": {"status", "read_array", "samps_per_chan_read"},
    "WriteAnalogF64Request": {
        "task", "num_samps_per_chan", "auto_start", "timeout", "data_layout_raw", "write_array",
    },
    "WriteAnalogF64Response": {"status", "samps_per_chan_written"},
    "WaitUntilTaskDoneRequest": {"task", "time_to_wait"},
    "IsTaskDoneResponse": {"is_task_done"},
    "TaskControlRequest": {"task", "action", "action_raw"},
    "GetErrorStringResponse": {"error_string"},
}  # fmt: skip


def own_calls():
    mine = set(vars(DaqServicer))
    return {
        name for name in vars(nidaqmx_pb2_grpc.NiDAQmxServicer) if name in mine and not name.startswith("_")
    }


def test_every_call_that_is_served_is_a_call_of_the_driver():
    tables = {*GETTERS, *SETTERS, *CHANNEL_GETTERS, *SYSTEM, *DEVICE_PROPERTIES}
    served = {n for n, v in vars(DaqServicer).items() if callable(v) and n[0].isupper()}
    assert served == own_calls()
    assert tables < served


def test_the_calls_have_the_fields_that_the_server_reads():
    for message, fields in FIELDS.items():
        known = set(getattr(nidaqmx_pb2, message).DESCRIPTOR.fields_by_name)
        assert fields <= known, message
    for name in {*GETTERS, *SETTERS, *CHANNEL_GETTERS, *SYSTEM, *DEVICE_PROPERTIES}:
        request = set(getattr(nidaqmx_pb2, f"{name}Request").DESCRIPTOR.fields_by_name)
        assert {"attribute", "attribute_raw"} <= request, name


def test_samples_travel_as_packed_doubles_in_field_2():
    field = nidaqmx_pb2.ReadAnalogF64Response.DESCRIPTOR.fields_by_name["read_array"]
    assert (field.number, field.type, field.is_packed) == (2, field.TYPE_DOUBLE, True)
    packed = nidaqmx_pb2.ReadAnalogF64Response(read_array=[1.5]).SerializeToString()
    assert packed[:2] == bytes([field.number << 3 | 2, 8])


def test_a_session_is_its_name():
    assert session_pb2.Session(name="ao").name == "ao"
    behaviors = session_pb2.DESCRIPTOR.enum_types_by_name["SessionInitializationBehavior"]
    assert [v.number for v in behaviors.values] == [0, 1, 2]


def test_errors_travel_under_the_names_the_client_looks_for():
    source = inspect.getsource(nidaqmx._grpc_interpreter)
    texts = {node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)}
    assert {"ni-error", "ni-samps-per-chan-read", "ni-samps-per-chan-written"} <= texts


def test_the_public_names_of_the_stubs():
    assert {"NiDAQmxStub", "NiDAQmxServicer", "add_NiDAQmxServicer_to_server"} <= set(vars(nidaqmx_pb2_grpc))
    assert len(nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"].methods) == 451

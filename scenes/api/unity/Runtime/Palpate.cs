// palpate in C#: a class over palpate.h (Native.cs). Plain .NET: it needs nothing of Unity, and runs under mono.
// Units are SI. A pose is 7 numbers: position x y z, rotation as a unit quaternion w x y z; right-handed, z up. Coordinates
// says how that lies in Unity. One thread at a time steps a world. Nothing calls back into managed code.

using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    /// <summary>What palpate could not do: what was wrong, where, and how to mend it.</summary>
    public class PalpateException : Exception
    {
        /// <summary>Of palpate.h.</summary>
        public readonly int Code;
        public PalpateException(int code, string message) : base(message) { Code = code; }
    }

    /// <summary>Fields that World.View shows: as PALPATE_POSITIONS and on in palpate.h.</summary>
    public enum Field
    {
        Positions, Forces, Touches, Pressures, Areas, Faces, SampleNodes, Nodes, RestNodes, Tetrahedra, Stretches,
        Configuration, JointsWanted, JointsSent, JointsReached, BonePoses, TrackedPoses, NetForces, NetTorques, Centres,
        ContactAreas, ObjectPoses, ObjectMotions, ObjectForces, ForcesByObject, SoftPositions, SoftForces, SoftTouches,
        SoftPressures, SoftAreas, SoftFaces, SoftSampleNodes, SoftNodes, SoftRestNodes, SoftTetrahedra, SoftStretches
    }

    /// <summary>Between palpate (right-handed, z up) and Unity (left-handed, y up): y and z change places.</summary>
    public static class Coordinates
    {
        /// <summary>A position, force or velocity.</summary>
        public static void ToUnity(double x, double y, double z, out float ux, out float uy, out float uz)
        {
            ux = (float)x;
            uy = (float)z;
            uz = (float)y;
        }

        public static void FromUnity(float ux, float uy, float uz, out double x, out double y, out double z)
        {
            x = ux;
            y = uz;
            z = uy;
        }

        /// <summary>A rotation; Unity's order is x y z w. A mirror turns it round.</summary>
        public static void RotationToUnity(double w, double x, double y, double z, out float ux, out float uy, out float uz, out float uw)
        {
            ux = (float)-x;
            uy = (float)-z;
            uz = (float)-y;
            uw = (float)w;
        }

        public static void RotationFromUnity(float ux, float uy, float uz, float uw, out double w, out double x, out double y, out double z)
        {
            w = uw;
            x = -ux;
            y = -uz;
            z = -uy;
        }

        /// <summary>A pose for World.SetFingerPose from Unity's position and rotation.</summary>
        public static double[] PoseFromUnity(float px, float py, float pz, float qx, float qy, float qz, float qw)
        {
            double[] pose = new double[7];
            FromUnity(px, py, pz, out pose[0], out pose[1], out pose[2]);
            RotationFromUnity(qx, qy, qz, qw, out pose[3], out pose[4], out pose[5], out pose[6]);
            return pose;
        }
    }

    /// <summary>A finger's pose from the joints of a tracked hand, as OpenXR and Unity's XR Hands have them.</summary>
    public static class HandJoints
    {
        /// <summary>Pose for World.SetFingerPose from the distal joint's position and rotation and the tip's position, in Unity:
        /// a joint's z points to the tip, its y to the back of the finger. Palpate's finger has x to the tip and z to the
        /// nail; its origin is midway.</summary>
        public static double[] FingerPose(float dx, float dy, float dz, float qx, float qy, float qz, float qw, float tx, float ty, float tz)
        {
            // Joint (x side, y dorsal, z distal, left-handed) to finger: columns distal, dorsal x distal, dorsal, in palpate's
            // right-handed world.
            double[] distal = Turned(qx, qy, qz, qw, 0, 0, 1), dorsal = Turned(qx, qy, qz, qw, 0, 1, 0);
            double[] side = { dorsal[1] * distal[2] - dorsal[2] * distal[1], dorsal[2] * distal[0] - dorsal[0] * distal[2],
                              dorsal[0] * distal[1] - dorsal[1] * distal[0] };
            double[] pose = new double[7];
            Coordinates.FromUnity((dx + tx) / 2, (dy + ty) / 2, (dz + tz) / 2, out pose[0], out pose[1], out pose[2]);
            // Quaternion of the matrix [distal side dorsal]; the largest component first, so that none is lost to rounding.
            double xx = distal[0], yy = side[1], zz = dorsal[2];
            double[] squares = { 1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz };
            int k = 0;
            for (int i = 1; i < 4; ++i) if (squares[i] > squares[k]) k = i;
            double a = side[2] - dorsal[1], b = dorsal[0] - distal[2], c = distal[1] - side[0];
            double ab = side[0] + distal[1], ac = dorsal[0] + distal[2], bc = dorsal[1] + side[2];
            double[][] rows = { new[] { squares[0], a, b, c }, new[] { a, squares[1], ab, ac }, new[] { b, ab, squares[2], bc },
                                new[] { c, ac, bc, squares[3] } };
            double length = 0;
            for (int i = 0; i < 4; ++i) length += rows[k][i] * rows[k][i];
            for (int i = 0; i < 4; ++i) pose[3 + i] = rows[k][i] / Math.Sqrt(length);
            return pose;
        }

        /// <summary>A vector of a joint's frame in palpate's world.</summary>
        static double[] Turned(double x, double y, double z, double w, double vx, double vy, double vz)
        {
            double cx = y * vz - z * vy + w * vx, cy = z * vx - x * vz + w * vy, cz = x * vy - y * vx + w * vz;
            return new double[] { vx + 2 * (y * cz - z * cy), vz + 2 * (x * cy - y * cx), vy + 2 * (z * cx - x * cz) };
        }
    }

    /// <summary>A scene that is being run.</summary>
    public sealed class World : IDisposable
    {
        long id;

        World(long id) { this.id = id; }
        ~World() { Dispose(); }

        /// <summary>Of palpate, for example "0.1.0".</summary>
        public static string Version { get { return Native.Said(Native.palpate_version()); } }

        /// <summary>Of palpate.h, as the library has it.</summary>
        public static int ApiVersion { get { return Native.palpate_api_version(); } }

        delegate int Maker(ref Native.WorldDef definition, out long world);

        static World Made(int threads, string[] settings, string folder, Maker make)
        {
            using (Pins pins = new Pins())
            {
                Native.WorldDef definition = new Native.WorldDef();
                Native.Check(Native.palpate_default_world_def(ref definition, Marshal.SizeOf(typeof(Native.WorldDef))));
                definition.Threads = threads;
                definition.SettingCount = settings == null ? 0 : settings.Length;
                definition.Settings = pins.Of(pins.Texts(settings));
                definition.Folder = pins.Text(folder);
                long id;
                Native.Check(make(ref definition, out id));
                return new World(id);
            }
        }

        /// <summary>From a scene file, or the name of a scene that comes with palpate; settings such as
        /// "solver.preset=balanced"; threads that a step uses, 0 for as many as the machine has.</summary>
        public static World Load(string file, string[] settings = null, int threads = 1)
        {
            return Made(threads, settings, null, (ref Native.WorldDef definition, out long world) =>
                Native.palpate_load(Native.Text(file), ref definition, out world));
        }

        /// <summary>From the text of a scene (TOML); `folder` is where the files that it names are.</summary>
        public static World LoadText(string text, string[] settings = null, int threads = 1, string folder = null)
        {
            return Made(threads, settings, folder, (ref Native.WorldDef definition, out long world) =>
                Native.palpate_load_text(Native.Text(text), ref definition, out world));
        }

        /// <summary>From descriptions; steps of `dt` [s]; `more`: further lines of the scene (TOML).</summary>
        public static World Build(FingerOptions[] fingers, ObjectOptions[] objects, double dt = 0.001, string preset = "balanced",
                                  string more = null, string[] settings = null, int threads = 1)
        {
            using (Pins pins = new Pins())
            {
                Native.SceneDef scene = new Native.SceneDef();
                Native.Check(Native.palpate_default_scene_def(ref scene, Marshal.SizeOf(typeof(Native.SceneDef))));
                scene.FingerCount = fingers.Length;
                scene.ObjectCount = objects.Length;
                scene.Fingers = Row(fingers, typeof(Native.FingerDef), f => new Native.FingerDef(f, pins), pins);
                scene.Objects = Row(objects, typeof(Native.ObjectDef), o => new Native.ObjectDef(o, pins), pins);
                scene.Dt = dt;
                scene.Preset = pins.Text(preset);
                scene.More = pins.Text(more);
                return Made(threads, settings, null, (ref Native.WorldDef definition, out long world) =>
                    Native.palpate_build(ref scene, ref definition, out world));
            }
        }

        /// <summary>Structs one after the other, as C has an array of them.</summary>
        static IntPtr Row<Options>(Options[] all, Type type, Func<Options, object> made, Pins pins)
        {
            int size = Marshal.SizeOf(type);
            byte[] bytes = new byte[Math.Max(1, size * all.Length)];
            IntPtr place = pins.Of(bytes);
            for (int i = 0; i < all.Length; ++i) Marshal.StructureToPtr(made(all[i]), new IntPtr(place.ToInt64() + i * size), false);
            return place;
        }

        /// <summary>Goes through a recorded run (1, 2, ...) again.</summary>
        public static World Replay(string file, int run, int threads = 1)
        {
            return Made(threads, null, null, (ref Native.WorldDef definition, out long world) =>
                Native.palpate_load_replay(Native.Text(file), run, ref definition, out world));
        }

        /// <summary>n steps of many worlds, in parallel, on all cores.</summary>
        public static void StepMany(World[] worlds, int n)
        {
            long[] ids = new long[worlds.Length];
            for (int i = 0; i < ids.Length; ++i) ids[i] = worlds[i].id;
            Native.Check(Native.palpate_step_many(ids, ids.Length, n));
            GC.KeepAlive(worlds);
        }

        /// <summary>Another world in the same state.</summary>
        public World Clone()
        {
            long clone;
            Native.Check(Native.palpate_clone(id, out clone));
            return new World(clone);
        }

        public void Dispose()
        {
            if (id != 0) Native.palpate_destroy(id);
            id = 0;
            GC.SuppressFinalize(this);
        }

        public WorldInfo Info
        {
            get
            {
                WorldInfo info = new WorldInfo();
                info.Size = Marshal.SizeOf(typeof(WorldInfo));
                Native.Check(Native.palpate_get_info(id, ref info));
                return info;
            }
        }

        public int FindFinger(string name)
        {
            int finger;
            Native.Check(Native.palpate_find_finger(id, Native.Text(name), out finger));
            return finger;
        }

        public int FindObject(string name)
        {
            int found;
            Native.Check(Native.palpate_find_object(id, Native.Text(name), out found));
            return found;
        }

        /// <summary>Changes settings while it runs: "finger.index.material.young_kPa=40".</summary>
        public void Set(params string[] settings)
        {
            using (Pins pins = new Pins()) Native.Check(Native.palpate_set(id, pins.Texts(settings), settings.Length));
        }

        /// <summary>A text of the world, or the name of finger or object `index`, the kind of thimble `index`.</summary>
        public string Text(Told text, int index = 0)
        {
            long needed;
            Native.Check(Native.palpate_get_text(id, (int)text, index, null, 0, out needed));
            byte[] bytes = new byte[needed];
            Native.Check(Native.palpate_get_text(id, (int)text, index, bytes, needed, out needed));
            return Encoding.UTF8.GetString(bytes, 0, bytes.Length - 1);
        }

        /// <summary>Ids of what there is now, in the order of rows of the world's fields (index -1).</summary>
        public int[] List(Part what)
        {
            int count;
            Native.Check(Native.palpate_list(id, (int)what, null, 0, out count));
            int[] ids = new int[count];
            if (count > 0) Native.Check(Native.palpate_list(id, (int)what, ids, count, out count));
            return ids;
        }

        /// <summary>A finger more, between steps: its id. Tens of milliseconds; the others go on with the same bits.</summary>
        public int AddFinger(FingerOptions options)
        {
            using (Pins pins = new Pins())
            {
                int added;
                Native.FingerDef definition = new Native.FingerDef(options, pins);
                Native.Check(Native.palpate_add_finger(id, ref definition, out added));
                return added;
            }
        }

        public void RemoveFinger(int finger) { Native.Check(Native.palpate_remove_finger(id, finger)); }

        public int AddObject(ObjectOptions options)
        {
            using (Pins pins = new Pins())
            {
                int added;
                Native.ObjectDef definition = new Native.ObjectDef(options, pins);
                Native.Check(Native.palpate_add_object(id, ref definition, out added));
                return added;
            }
        }

        public void RemoveObject(int index) { Native.Check(Native.palpate_remove_object(id, index)); }

        /// <summary>The simulated thimble that a finger wears from now on; null: none.</summary>
        public void SetThimble(int finger, string kind, string method = null)
        {
            Native.Check(Native.palpate_set_thimble(id, finger, Native.Text(kind), Native.Text(method)));
        }

        /// <summary>Tracked pose of a finger from the next step on; null: its tracker does not see it.</summary>
        public void SetFingerPose(int finger, double[] pose)
        {
            CheckPose(pose, true);
            Native.Check(Native.palpate_set_finger_pose(id, finger, pose));
        }

        public void ReleaseFinger(int finger) { Native.Check(Native.palpate_release_finger(id, finger)); }

        public void SetObjectPose(int index, double[] pose)
        {
            CheckPose(pose, false);
            Native.Check(Native.palpate_set_object_pose(id, index, pose));
        }

        public void ReleaseObject(int index) { Native.Check(Native.palpate_release_object(id, index)); }

        internal static void CheckPose(double[] pose, bool mayBeNull)
        {
            if (pose == null ? !mayBeNull : pose.Length != 7)
                throw new ArgumentException("a pose is 7 numbers: position x y z [m], rotation w x y z");
        }

        public void Step(int n)
        {
            Native.Check(Native.palpate_step(id, n));
            GC.KeepAlive(this);  // no finalizer comes between
        }

        /// <summary>Until the simulated time [s] is reached to half a step: in Unity from FixedUpdate, with
        /// Time.fixedTimeAsDouble.</summary>
        public void StepTo(double time)
        {
            Native.Check(Native.palpate_step_to(id, time));
            GC.KeepAlive(this);
        }

        Native.View Shown(Field field, int index)
        {
            Native.View view = new Native.View();
            view.Size = Marshal.SizeOf(typeof(Native.View));
            Native.Check(Native.palpate_view(id, (int)field, index, ref view));
            return view;
        }

        /// <summary>Numbers of a field row by row, into an array that is made anew only where it has another size.</summary>
        public void Read(Field field, int index, ref double[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 0) throw new ArgumentException(field + " has whole numbers");
            int size = view.Rows * (view.Rank == 2 ? view.Columns : 1);
            if (numbers == null || numbers.Length != size) numbers = new double[size];
            if (size > 0) Marshal.Copy(view.Data, numbers, 0, size);
        }

        public void Read(Field field, int index, ref int[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 1) throw new ArgumentException(field + " has no integers");
            int size = view.Rows * (view.Rank == 2 ? view.Columns : 1);
            if (numbers == null || numbers.Length != size) numbers = new int[size];
            if (size > 0) Marshal.Copy(view.Data, numbers, 0, size);
        }

        public void Read(Field field, int index, ref byte[] numbers)
        {
            Native.View view = Shown(field, index);
            if (view.Type != 2) throw new ArgumentException(field + " has no bytes");
            if (numbers == null || numbers.Length != view.Rows) numbers = new byte[view.Rows];
            if (view.Rows > 0) Marshal.Copy(view.Data, numbers, 0, view.Rows);
        }

        public FingerState Finger(int finger)
        {
            FingerState state = new FingerState();
            state.Size = Marshal.SizeOf(typeof(FingerState));
            Native.Check(Native.palpate_get_finger(id, finger, ref state));
            return state;
        }

        public ObjectState Object(int index)
        {
            ObjectState state = new ObjectState();
            state.Size = Marshal.SizeOf(typeof(ObjectState));
            Native.Check(Native.palpate_get_object(id, index, ref state));
            return state;
        }

        public ThimbleState Thimble(int thimble)
        {
            ThimbleState state = new ThimbleState();
            state.Size = Marshal.SizeOf(typeof(ThimbleState));
            Native.Check(Native.palpate_get_thimble(id, thimble, ref state));
            return state;
        }

        /// <summary>From now on every step leaves a snapshot for ReadSnapshot.</summary>
        public void KeepSnapshots(bool on) { Native.Check(Native.palpate_keep_snapshots(id, on ? 1 : 0)); }

        /// <summary>From any thread: a finger in the newest snapshot, positions and forces [samples][3], never parts of two
        /// steps. Arrays are made anew only where they have another size.</summary>
        public FingerState ReadSnapshot(int finger, ref double[] positions, ref double[] forces)
        {
            FingerState state = new FingerState();
            state.Size = Marshal.SizeOf(typeof(FingerState));
            int samples;
            Native.Check(Native.palpate_read_snapshot(id, finger, ref state, null, null, 0, out samples));
            if (positions == null || positions.Length != 3 * samples) positions = new double[3 * samples];
            if (forces == null || forces.Length != 3 * samples) forces = new double[3 * samples];
            Native.Check(Native.palpate_read_snapshot(id, finger, ref state, positions, forces, samples, out samples));
            return state;
        }

        /// <summary>So many frames per simulated second are kept for Text(Told.Report), an HTML page; 0: none.</summary>
        public void KeepFrames(double perSecond) { Native.Check(Native.palpate_keep_frames(id, perSecond)); }

        /// <summary>From the first step on every step is recorded, for `palpate replay` and World.Replay.</summary>
        public void Record(string file) { Native.Check(Native.palpate_record(id, Native.Text(file))); }

        public void EndRecording() { Native.Check(Native.palpate_end_recording(id)); }

        /// <summary>The whole state: a branch point.</summary>
        public byte[] Save()
        {
            long needed;
            Native.Check(Native.palpate_save(id, null, 0, out needed));
            byte[] state = new byte[needed];
            Native.Check(Native.palpate_save(id, state, needed, out needed));
            return state;
        }

        public void Restore(byte[] state) { Native.Check(Native.palpate_restore(id, state, state.LongLength)); }

        public ReplayState Replayed
        {
            get
            {
                ReplayState state = new ReplayState();
                state.Size = Marshal.SizeOf(typeof(ReplayState));
                Native.Check(Native.palpate_get_replay(id, ref state));
                return state;
            }
        }
    }
}
